// The page's data back to what splats.js draws: columns.py has how they were packed.

// A column of n whole numbers: zigzag differences along the rows, byte planes, low bytes first.
function readColumn(data, at, n, bytes) {
  const column = new Int32Array(n);
  for (let i = 0, value = 0; i < n; i++) {
    let code = 0;
    for (let b = 0; b < bytes; b++) code |= data[at + b * n + i] << (8 * b);
    value = (value + ((code >>> 1) ^ -(code & 1))) | 0;
    column[i] = value;
  }
  return column;
}

function readColumns(data, count, described) {
  const columns = {};
  let at = 0;
  for (const [name, bytes] of described) {
    columns[name] = readColumn(data, at, count, bytes);
    at += bytes * count;
  }
  if (at !== data.length) throw new Error("the page's data are cut short");
  return columns;
}

// The three smaller parts of a quaternion, in units of 1/steps, and which one was left out: all four (wxyz).
function quatOf(columns, i, steps, out) {
  let rest = 1;
  for (let k = 0; k < 3; k++) {
    const value = columns[`quat_${k}`][i] / steps;
    out[k + (k >= columns.quat_largest[i])] = value;
    rest -= value * value;
  }
  out[columns.quat_largest[i]] = Math.sqrt(Math.max(rest, 0));
}

// Means (3n) in page units.
function meansOf(columns, count, scene) {
  const means = new Float32Array(3 * count);
  if (!columns.view) {
    for (let k = 0; k < 3; k++) {
      const column = columns[`mean_${k}`];
      for (let i = 0; i < count; i++) means[3 * i + k] = Math.sinh(column[i] * scene.meanStep) * scene.meanKnee;
    }
    return means;
  }
  for (let i = 0; i < count; i++) {
    const { K: [fx, skew, fy, cx, cy], rotation: [right, down, forward], position } = scene.views[columns.view[i] % OTHER_LAYERS];
    const z = 2 ** (columns.depth[i] / scene.depthSteps), y = ((columns.pixel_1[i] / scene.pixelSteps - cy) / fy) * z;
    const x = ((columns.pixel_0[i] / scene.pixelSteps - cx) * z - skew * y) / fx;
    for (let k = 0; k < 3; k++) means[3 * i + k] = position[k] + right[k] * x + down[k] * y + forward[k] * z;
  }
  return means;
}

const OTHER_LAYERS = 64; // added to the views of Gaussians that are no surface of a photo

// SH coefficients from components: mean + Σ component·step·basis, or the components themselves without a basis.
function coloursOf(columns, count, scene) {
  const { mean, basis, step } = scene.sh, width = mean.length, rank = basis ? basis.length : width;
  const sh = new Float32Array(width * count), values = new Float64Array(width);
  const parts = Array.from({ length: rank }, (_, r) => columns[`sh_${r}`]);
  for (let i = 0; i < count; i++) {
    values.set(mean);
    for (let r = 0; r < rank; r++) {
      const part = parts[r][i] * step;
      if (!basis) values[r] += part;
      else if (part) for (let k = 0, row = basis[r]; k < width; k++) values[k] += part * row[k];
    }
    sh.set(values, width * i);
  }
  return sh;
}

export async function unpack(scene, compressed) {
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const columns = readColumns(new Uint8Array(await new Response(stream).arrayBuffer()), scene.count, scene.columns);
  const { count } = scene, [steps, lowest] = scene.logSteps, parts = [], quats = new Float32Array(4 * count), quat = [0, 0, 0, 0];
  const scales = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    const owner = columns.view ? columns.view[i] : -1;
    if (parts.at(-1)?.owner !== owner) parts.push({ owner, view: owner < 0 ? -1 : owner % OTHER_LAYERS, isFront: owner >= 0 && owner < OTHER_LAYERS, from: i });
    parts.at(-1).to = i + 1;
    quatOf(columns, i, scene.quatSteps, quat);
    quats.set(quat, 4 * i);
    for (let k = 0; k < 3; k++) scales[3 * i + k] = columns[`scale_${k}`][i] ? 2 ** (columns[`scale_${k}`][i] / steps - lowest) : 0;
  }
  return {
    count, means: meansOf(columns, count, scene), quats, scales, opacities: Float32Array.from(columns.opacity, (code) => code / 255),
    sh: coloursOf(columns, count, scene), functions: scene.sh.mean.length / 3, parts, views: scene.views,
  };
}
