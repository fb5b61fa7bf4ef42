// Runs the networks of files of photos, with onnxruntime-web from beside the page: graphs/predict.py in JavaScript.
import { viewOf } from "./scene.js";
import { add, scaled } from "./vectors.js";

const FIELDS = { means: 3, quats: 4, scales: 3, opacities: 1 };
const FAR_FROM_ORIGIN = 128; // near planes, beyond which results keep an origin of their own

const middleOf = (views) => scaled(views.reduce((sum, { position }) => add(sum, position), [0, 0, 0]), 1 / views.length);

// What a network is fed with: photos grown to its stride by repeating their edges, cameras about their mean centre.
export function networkInputs({ photos, width, height, cameras, near, far }, { stride, minSide }) {
  const views = cameras.map(viewOf), middle = middleOf(views), count = views.length;
  const [tall, wide] = [height, width].map((side) => stride * Math.max(Math.ceil(side / stride), Math.ceil(minSide / stride)));
  const images = new Float32Array(count * 3 * tall * wide);
  photos.forEach((photo, v) => {
    for (let c = 0, at = v * 3 * tall * wide; c < 3; c++) for (let y = 0; y < tall; y++) for (let x = 0; x < wide; x++) {
      images[at++] = photo[3 * (Math.min(y, height - 1) * width + Math.min(x, width - 1)) + c];
    }
  });
  const K = cameras.flatMap(({ fx, fy, cx, cy, skew }) => [fx / wide, skew / wide, cx / wide, 0, fy / tall, cy / tall, 0, 0, 1]);
  const c2w = views.flatMap(({ rotation: [right, down, forward], position }) => [
    ...[0, 1, 2].flatMap((k) => [right[k], down[k], forward[k], position[k] - middle[k]]), 0, 0, 0, 1]);
  return {
    images: [images, [count, 3, tall, wide]], K: [Float32Array.from(K), [count, 3, 3]], c2w: [Float32Array.from(c2w), [count, 4, 4]],
    near: [new Float32Array(count).fill(near), [count]], far: [new Float32Array(count).fill(far), [count]],
  };
}

// The rows and columns of a photo of an array (views, rows, columns, …) that may be larger.
function cropped({ data, dims: [views, rows, columns, ...rest] }, height, width) {
  const size = rest.reduce((product, side) => product * side, 1), out = new Float32Array(views * height * width * size);
  for (let v = 0; v < views; v++) for (let y = 0; y < height; y++) {
    const from = size * (v * rows + y) * columns;
    out.set(data.subarray(from, from + size * width), size * (v * height + y) * width);
  }
  return out;
}

// What tsplat.js takes of a network's outputs, { name: { data, dims } }.
export function predictionOf(outputs, { width, height, cameras, near }) {
  const middle = middleOf(cameras.map(viewOf)), layers = [];
  const isFar = Math.max(...cameras.map(({ c2w }) => Math.hypot(c2w[3], c2w[7], c2w[11]))) > FAR_FROM_ORIGIN * near;
  for (let n = 0; n === 0 || outputs[`layer${n}_means`]; n++) {
    const prefix = n ? `layer${n}_` : "", { dims } = outputs[`${prefix}means`], shape = n ? dims.slice(1, 3) : [height, width];
    const layer = { height: shape[0], width: shape[1], degree: Math.sqrt(outputs[`${prefix}sh`].dims[3]) - 1 };
    for (const name of [...Object.keys(FIELDS), "sh"]) layer[name] = cropped(outputs[prefix + name], ...shape);
    for (const values of [layer.means, layer.quats, layer.scales, layer.opacities, layer.sh]) {
      if (!values.every(Number.isFinite)) throw new Error("the network returned values that are not finite");
    }
    if (!isFar) for (let i = 0; i < layer.means.length; i++) layer.means[i] += middle[i % 3];
    for (let i = 0; i < layer.opacities.length; i++) layer.opacities[i] = Math.min(Math.max(layer.opacities[i], 0), 1);
    const K = n ? outputs[`${prefix}K`].data : null;
    layer.cameras = cameras.map((camera, v) => (K ? {
      ...camera, width: shape[1], height: shape[0], fx: K[9 * v], skew: K[9 * v + 1], cx: K[9 * v + 2], fy: K[9 * v + 4], cy: K[9 * v + 5],
    } : camera));
    layers.push(layer);
  }
  return { layers, origin: isFar ? middle : [0, 0, 0] };
}

// given: { runtime and wasm: files of onnxruntime-web, most: pixels of a photo, models: { sha256: { file, stride, minSide } } }.
export function networkRunner(given) {
  const beside = (name) => new URL(name, location.href).href;
  let session = null, of = "";
  return async (request) => {
    const model = given.models[request.sha256];
    if (!model) throw new Error(`needs the network ${request.name} of another version than the one beside this page`);
    if (request.width * request.height > given.most) throw new Error(`photos of ${request.width}x${request.height} are too large for a page; decode the file with tinysplat`);
    const ort = await import(beside(given.runtime));
    ort.env.wasm.wasmPaths = { wasm: beside(given.wasm) };
    if (of !== request.sha256) [session, of] = [await ort.InferenceSession.create(beside(model.file)), request.sha256];
    const inputs = Object.entries(networkInputs(request, model)).map(([name, [data, dims]]) => [name, new ort.Tensor("float32", data, dims)]);
    return predictionOf(await session.run(Object.fromEntries(inputs)), request);
  };
}
