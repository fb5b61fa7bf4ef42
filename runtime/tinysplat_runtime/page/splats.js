// Draws Gaussians as tinysplat_runtime/render does (docs/CONVENTIONS.md, "Drawing"): exact EWA, dilation by the
// screen's pixel or the Gaussian's own, alpha from 1/255 on and up to 0.99, order by depth z, near views first. A frame
// is two passes: each Gaussian is projected once, in sorted order, into a texture of records, and the records are drawn
// as triangles, front to back, into half floats whose alpha is what still shines through. Now and then pixels that
// nothing shines through any more are closed by depth, so that what lies behind costs nothing. Nothing is instanced:
// hardware and software alike take far longer over many instances of a few vertices.
import { ARITHMETIC } from "./arithmetic.js";
import { sorting } from "./near.js";

const TEXTURE_WIDTH = 4096;
const COPY = 0x80000000; // marks a Gaussian that is drawn first, with its view's part of its alphas
const DARK = 1 / 1024; // transmittance of a pixel that is closed
const BLUR_SIDE = 16; // texels of the picture that lies behind
const SOFT = 0.07; // of a photo's shorter side, over which a picture fades beyond it
const CLOSINGS = [0.1, 0.2, 0.35, 0.5, 0.75]; // shares of the Gaussians after which dark pixels are closed

const PROJECT = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D order;             // indices of Gaussians, nearest first
uniform usampler2D geometry, colours; // two texels a Gaussian; one texel an SH function
uniform sampler2D shares;             // by view: of its surface's alphas, that come first, and of its opacities
uniform uint count;
uniform mat3 projection;              // K R without the principal point
uniform vec3 eye;                     // camera centre
uniform vec2 principal, size;         // pixels
uniform float nearPlane, leastOpacity;
uniform float focal;                  // pixels, to measure own pixels with
uniform bool fades;                   // whether what lies beyond the pictures' edges is drawn fainter
uniform vec2 logSteps;                // of lengths' codes: steps to a doubling, and what was added
uniform int functions;                // SH functions
uniform vec3 depths;                  // 1/nearest, 1/farthest, and whether they are drawn in place of colours
layout(location = 0) out uvec4 shape; // centre in clip coordinates, and the longer half axis, where the exponent is 1
layout(location = 1) out uvec4 paint; // length of the shorter half axis, colour and part of alpha in half floats, logarithm of opacity
uint index;
const float MARGIN = 0.15;
${ARITHMETIC}
uvec4 texel(usampler2D source, uint at) {
  return texelFetch(source, ivec2(at % ${TEXTURE_WIDTH}u, at / ${TEXTURE_WIDTH}u), 0);
}

float length16(uint code) { return code == 0u ? 0.0 : exp2(float(code) / logSteps.x - logSteps.y); }

vec3 sh(uint n) {
  uvec2 code = texel(colours, index * uint(functions) + n).xy;
  return vec3(unpackHalf2x16(code.x), unpackHalf2x16(code.y).x);
}

vec3 seen(vec3 d) { // the colour along the unit vector d
  float x = d.x, y = d.y, z = d.z;
  vec3 c = 0.5 + Y0() * sh(0u);
  if (functions < 4) return c;
  c += Y1(y) * sh(1u) + Y2(z) * sh(2u) + Y3(x) * sh(3u);
  if (functions < 9) return c;
  c += Y4(x, y) * sh(4u) + Y5(y, z) * sh(5u) + Y6(x, y, z) * sh(6u) + Y7(x, z) * sh(7u) + Y8(x, y) * sh(8u);
  if (functions < 16) return c;
  c += Y9(x, y) * sh(9u) + Y10(x, y, z) * sh(10u) + Y11(x, y, z) * sh(11u) + Y12(x, y, z) * sh(12u)
    + Y13(x, y, z) * sh(13u) + Y14(x, y, z) * sh(14u) + Y15(x, y) * sh(15u);
  if (functions < 25) return c;
  return c + Y16(x, y) * sh(16u) + Y17(x, y, z) * sh(17u) + Y18(x, y, z) * sh(18u) + Y19(y, z) * sh(19u)
    + Y20(z) * sh(20u) + Y21(x, z) * sh(21u) + Y22(x, y, z) * sh(22u) + Y23(x, y, z) * sh(23u) + Y24(x, y) * sh(24u);
}

vec3 ramp(float t) { // from near, bright, to far, dark
  return clamp(vec3(1.5 - 3.0 * abs(t - 0.75), 1.5 - 3.0 * abs(t - 0.5), 1.5 - 3.0 * abs(t - 0.25)), 0.0, 1.0);
}

void main() {
  shape = uvec4(0u);
  paint = uvec4(0u, 0u, 0u, floatBitsToUint(-100.0));
  uint place = uint(gl_FragCoord.y) * ${TEXTURE_WIDTH}u + uint(gl_FragCoord.x);
  if (place >= count) return;
  index = texel(order, place).x;
  bool isCopy = (index & ${COPY}u) != 0u;
  index &= ${COPY - 1}u;
  uvec4 first = texel(geometry, 2u * index), second = texel(geometry, 2u * index + 1u);
  float opacity = float(first.w & 0xffu) / 255.0;
  vec3 ray = uintBitsToFloat(first.xyz) - eye;
  vec3 point = projection * ray;
  if (opacity < leastOpacity || point.z <= nearPlane) return;
  vec2 centred = point.xy / point.z;
  vec2 clamped = clamp(centred, -MARGIN * size - principal, (1.0 + MARGIN) * size - principal);
  mat3 rows = transpose(projection);
  vec4 q = vec4(unpackSnorm2x16(second.x), unpackSnorm2x16(second.y));
  vec3 s = vec3(length16(second.z & 0xffffu), length16(second.z >> 16), length16(second.w & 0xffffu));
  vec3 m1 = across(jacobian(rows[0], rows[2], clamped.x, point.z), q, s);
  vec3 m2 = across(jacobian(rows[1], rows[2], clamped.y, point.z), q, s);
  vec3 area = cross3(m1, m2);
  float a = dot3(m1, m1), b = dot3(m1, m2), c = dot3(m2, m2), det = dot3(area, area);
  uint view = (first.w >> 8) & 0xffffu;
  float own = focal * length16(second.w >> 16) / point.z;
  if (view == 0u && own > 0.0) own = max(own, 1.0); // a list is as it was trained from afar
  vec2 wider = widening(a, b, c, det, own);
  det += wider.x * (a + c + wider.x);
  a += wider.x;
  c += wider.x;
  vec2 share = texelFetch(shares, ivec2(view, 0), 0).xy;
  opacity *= wider.y * share.y;
  float part = isCopy ? share.x : 1.0; // of its alphas, that the picture in front has
  if (fades) opacity *= float(first.w >> 24) / 255.0;
  float reach = log(opacity / LEAST_ALPHA); // the exponent at which the footprint ends
  vec2 pixel = centred + principal, extent = sqrt(2.0 * reach * vec2(a, c));
  if (reach <= 0.0 || any(lessThan(pixel + extent, vec2(0.0))) || any(greaterThan(pixel - extent, size))) return;
  vec3 axes = halfAxes(a, b, c, det);
  shape = floatBitsToUint(vec4(pixel / size * vec2(2.0, -2.0) + vec2(-1.0, 1.0), axes.xy));
  vec3 shown = depths.z > 0.0 ? ramp((1.0 / point.z - depths.y) / (depths.x - depths.y)) : max(seen(normalize(ray)), 0.0);
  paint = uvec4(floatBitsToUint(axes.z), packHalf2x16(shown.xy), packHalf2x16(vec2(shown.z, part)),
    floatBitsToUint(log(opacity)));
}`;

const TRIANGLE = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D shapes, paints;
uniform vec2 size;
out vec2 place;
flat out vec4 paint;
flat out float part;
const float LEAST = -5.541263545158426; // log(1/255)
const vec2 CORNERS[3] = vec2[3](vec2(0.0, 2.0), vec2(-1.7320509, -1.0), vec2(1.7320509, -1.0)); // around the unit circle
void main() {
  int at = gl_VertexID / 3;
  ivec2 texel = ivec2(at % ${TEXTURE_WIDTH}, at / ${TEXTURE_WIDTH});
  vec4 shape = uintBitsToFloat(texelFetch(shapes, texel, 0));
  uvec4 code = texelFetch(paints, texel, 0);
  paint = vec4(unpackHalf2x16(code.y), unpackHalf2x16(code.z).x, uintBitsToFloat(code.w));
  part = unpackHalf2x16(code.z).y;
  vec2 major = shape.zw;
  vec2 minor = uintBitsToFloat(code.x) * (major == vec2(0.0) ? major : normalize(vec2(-major.y, major.x)));
  place = CORNERS[gl_VertexID % 3] * sqrt(max(paint.a - LEAST, 0.0));
  gl_Position = vec4(shape.xy + 2.0 * (place.x * major + place.y * minor) / size * vec2(1.0, -1.0), 0.0, 1.0);
}`;

const PAINT = `#version 300 es
precision highp float;
in vec2 place;
flat in vec4 paint;
flat in float part;
out vec4 result;
void main() {
  float alpha = min(exp(paint.a - dot(place, place)), 0.99);
  if (alpha < 1.0 / 255.0) discard;
  alpha *= part;
  result = vec4(paint.rgb * alpha, alpha);
}`;

const CLOSE = `#version 300 es
precision highp float;
uniform sampler2D picture;
uniform float most; // transmittance of pixels that count as closed
void main() { if (texelFetch(picture, ivec2(gl_FragCoord.xy), 0).a > most) discard; }`;

const WHOLE = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

// The photo's own colours, far from sharp: what shines through where nothing is known, and dark beyond its frame.
const BLUR = `#version 300 es
precision highp float;
uniform sampler2D picture;
uniform vec4 frame;  // left, bottom, right and top of what shows of the photo, in shares of the picture
uniform vec3 ground;
uniform float level; // of detail, at which a texel is as large as one of these
out vec4 result;
void main() {
  vec2 place = mix(frame.xy, frame.zw, gl_FragCoord.xy / ${BLUR_SIDE}.0);
  vec4 sum = vec4(ground, 1.0) * 0.02;
  for (float n = 0.0; n < 3.0; n++) {
    vec4 seen = textureLod(picture, place, level + n);
    sum += vec4(seen.rgb, 1.0 - seen.a) * pow(0.1, n);
  }
  result = vec4(clamp(sum.rgb / sum.a, 0.0, 1.0), 1.0);
}`;

const SHOW = `#version 300 es
precision highp float;
uniform sampler2D picture, blurred;
uniform vec2 share;  // of the picture's texels to those of the canvas
uniform vec4 frame;  // the photo's, in shares of the canvas
uniform vec2 soft;   // how far the picture fades beyond it; 0 without a frame
uniform float light; // what is left of the picture's
uniform vec3 ground; // shines through without a frame
out vec4 result;
void main() {
  vec2 place = gl_FragCoord.xy * share;
  vec4 seen = texture(picture, place);
  vec3 behind = ground;
  float inside = 1.0;
  if (soft.x > 0.0) {
    vec2 kept = clamp(place, frame.xy, frame.zw), within = mix(vec2(0.5 / ${BLUR_SIDE}.0), vec2(1.0 - 0.5 / ${BLUR_SIDE}.0), (kept - frame.xy) / (frame.zw - frame.xy));
    float far = length((place - kept) / soft);
    inside = 1.0 - smoothstep(0.0, 1.0, far);
    behind = vec3(0.0);
    for (int n = 0; n < 9; n++) behind += texture(blurred, within + vec2(n % 3 - 1, n / 3 - 1) / ${BLUR_SIDE}.0).rgb / 9.0;
    behind *= mix(1.0, 0.4, smoothstep(0.0, 1.2, far));
  }
  seen = vec4(clamp(seen.rgb, 0.0, 1.0) * inside, 1.0 - (1.0 - seen.a) * inside);
  result = vec4(mix(0.4 * behind, seen.rgb + seen.a * behind, light), 1.0);
}`;

function work(sorting) {
  // in a worker: orders Gaussians
  let order;
  onmessage = ({ data }) => {
    if (data.means) order = sorting(data.means, data.parts);
    else {
      const sorted = order(data.plane, data.nearPlane, data.shares);
      postMessage({ sorted, id: data.id }, { transfer: [sorted.buffer] });
    }
  };
}

const SORTER = "tsplat-sorter";
const { url } = import.meta;
if (/** @type {any} */ (globalThis).name === SORTER) work(sorting);

// A worker of this file, or where the page carries its scripts, of the text of what it runs.
function sorter() {
  if (!url.startsWith("blob:")) return new Worker(url, { type: "module", name: SORTER });
  const text = `"use strict";(${work})(${sorting})`;
  return new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
      throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(made));
  const uniforms = {};
  for (let i = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) {
    const { name } = gl.getActiveUniform(made, i);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { made, uniforms };
}

const WORDS = { 1: ["R32UI", "RED_INTEGER"], 2: ["RG32UI", "RG_INTEGER"], 4: ["RGBA32UI", "RGBA_INTEGER"] };

// A texture whose texels are read one by one.
function plainTexture(gl, inner, width, height) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  gl.texStorage2D(gl.TEXTURE_2D, 1, inner, width, height);
  return texture;
}

// A texture of at least `count` texels of `words` whole numbers each, filled row by row with `data` if there are any.
function dataTexture(gl, count, words, data) {
  const height = Math.max(1, Math.ceil(count / TEXTURE_WIDTH));
  const limit = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  if (height > limit)
    throw new Error(`more Gaussians than this device's textures hold (${height} rows, at most ${limit})`);
  const [inner, format] = WORDS[words].map((name) => gl[name]);
  const texture = plainTexture(gl, inner, TEXTURE_WIDTH, height);
  if (data) fill(gl, data, words, format);
  return texture;
}

// The first texels of the bound texture.
function fill(gl, data, words, format) {
  const row = TEXTURE_WIDTH * words;
  const rows = Math.floor(data.length / row);
  const rest = data.subarray(rows * row);
  const put = (y, width, height, part) =>
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, y, width, height, format, gl.UNSIGNED_INT, part);
  if (rows) put(0, TEXTURE_WIDTH, rows, data.subarray(0, rows * row));
  if (rest.length) put(rows, rest.length / words, 1, rest);
}

// Where a window shows the camera's own picture: left, bottom, right and top, in shares of the window.
function pictureIn({ width, height, zoom }, window) {
  const scale = Math.min(window.width / width, window.height / height) * zoom;
  const half = [width / window.width, height / window.height].map((side) => (scale * side) / 2);
  return [...half.map((side) => 0.5 - side), ...half.map((side) => 0.5 + side)];
}

function bindTextures(gl, uniforms, textures) {
  Object.entries(textures).forEach(([name, texture], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(uniforms[name], unit);
  });
}

export class Splats {
  // onSorted is called when a new order is at hand.
  constructor(canvas, onSorted) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL2");
    this.gl = gl;
    this.onSorted = onSorted;
    this.isHalf = Boolean(gl.getExtension("EXT_color_buffer_half_float") || gl.getExtension("EXT_color_buffer_float"));
    this.project = program(gl, WHOLE, PROJECT);
    this.paint = program(gl, TRIANGLE, PAINT);
    this.close = program(gl, WHOLE, CLOSE);
    this.show = program(gl, WHOLE, SHOW);
    this.blur = program(gl, WHOLE, BLUR);
    this.blurred = { texture: gl.createTexture(), frame: gl.createFramebuffer() };
    gl.bindTexture(gl.TEXTURE_2D, this.blurred.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, BLUR_SIDE, BLUR_SIDE);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.blurred.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.blurred.texture, 0);
    this.empty = gl.createVertexArray();
    this.recordFrame = gl.createFramebuffer();
    this.target = { texture: gl.createTexture(), frame: gl.createFramebuffer(), width: 0, height: 0 };
    this.closed = { depth: gl.createRenderbuffer(), frame: gl.createFramebuffer() };
    this.sortedCount = -1; // none yet
    this.asked = this.answered = this.oldest = 0;
  }

  // Takes a cloud (cloud.js) in place of the one before.
  load(cloud) {
    const { gl } = this;
    const { count, functions } = cloud;
    this.#release();
    this.cloud = cloud;
    this.most = 2 * count; // places of an order: surfaces stand in it twice
    this.textures = {
      order: dataTexture(gl, this.most, 1),
      geometry: dataTexture(gl, 2 * count, 4, cloud.geometry),
      colours: dataTexture(gl, functions * count, 2, cloud.colours),
    };
    cloud.geometry = cloud.colours = null; // the textures have them
    this.records = { shapes: dataTexture(gl, this.most, 4), paints: dataTexture(gl, this.most, 4) };
    this.shares = plainTexture(gl, gl.RG32F, cloud.viewCount + 1, 1);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.recordFrame);
    const places = [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1];
    Object.values(this.records).forEach((texture, i) =>
      gl.framebufferTexture2D(gl.FRAMEBUFFER, places[i], gl.TEXTURE_2D, texture, 0),
    );
    gl.drawBuffers(places);
    this.#startSorter();
  }

  stop() {
    this.worker?.terminate();
  }

  // Draws nothing from now on.
  clear() {
    const { gl } = this;
    this.#release();
    this.textures = this.records = this.shares = null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  #release() {
    const { gl } = this;
    this.worker?.terminate();
    for (const texture of [
      ...Object.values(this.textures ?? {}),
      ...Object.values(this.records ?? {}),
      this.shares ?? null,
    ])
      gl.deleteTexture(texture);
    this.sortedCount = -1;
    this.asked = this.answered = this.oldest = 0;
  }

  #startSorter() {
    const { gl, cloud } = this;
    this.worker = sorter();
    this.worker.postMessage({ means: cloud.means, parts: cloud.parts });
    this.worker.onmessage = ({ data }) => {
      const { sorted } = data;
      this.answered = data.id;
      this.sortedCount = sorted.length;
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, this.textures.order);
      fill(gl, sorted, 1, gl.RED_INTEGER);
      this.onSorted();
    };
  }

  // Whether the last order asked for is at hand.
  get isSorted() {
    return this.answered === this.asked;
  }

  // Whether there is an order that will do: one from about where the camera is.
  get hasOrder() {
    return this.sortedCount >= 0 && this.answered >= this.oldest;
  }

  // Asks for the order seen from a camera (see camera.js), by views' shares (near.js). isElsewhere: no order from
  // before will do.
  sort(camera, nearPlane, shares, isElsewhere) {
    if (isElsewhere) this.oldest = this.asked + 1;
    const [x, y, z] = camera.rotation[2];
    const [px, py, pz] = camera.position;
    this.worker.postMessage({ plane: [x, y, z, -(x * px + y * py + z * pz)], nearPlane, shares, id: ++this.asked });
  }

  // Draws one frame; `share` < 1 draws fewer pixels and enlarges them, for as long as things move.
  draw(camera, options, share = 1) {
    const { gl } = this;
    const { canvas } = gl;
    const width = Math.max(1, Math.round(canvas.width * share));
    const height = Math.max(1, Math.round(canvas.height * share));
    this.#resize(width, height);
    const view = camera.fitted(width, height);
    this.#projectAll(view, camera.position, width, height, options);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.viewport(0, 0, width, height);
    gl.depthMask(true);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const places = [0, ...CLOSINGS, 1].map((part) => Math.round(part * this.sortedCount));
    for (let i = 0; i + 1 < places.length; i++) {
      if (i) this.#close();
      this.#paint(places[i], places[i + 1], width, height);
    }
    gl.disable(gl.DEPTH_TEST);
    const ground = options.ground ?? [0, 0, 0];
    const frame = options.isFramed ? pictureIn(camera, canvas) : [0, 0, 1, 1];
    if (options.isFramed && options.follow) this.#follow(frame, ground, options.follow);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.useProgram(this.show.made);
    bindTextures(gl, this.show.uniforms, { picture: this.target.texture, blurred: this.blurred.texture });
    const soft = SOFT * Math.min((frame[2] - frame[0]) * canvas.width, (frame[3] - frame[1]) * canvas.height);
    gl.uniform4fv(this.show.uniforms.frame, frame);
    gl.uniform2f(this.show.uniforms.soft, options.isFramed ? soft / canvas.width : 0, soft / canvas.height);
    gl.uniform2f(this.show.uniforms.share, 1 / canvas.width, 1 / canvas.height);
    gl.uniform1f(this.show.uniforms.light, options.light ?? 1);
    gl.uniform3fv(this.show.uniforms.ground, ground);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Brings what lies behind nearer to the picture's own colours, by a share.
  #follow(frame, ground, share) {
    const { gl, target, blur } = this;
    const { uniforms } = blur;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.blurred.frame);
    gl.viewport(0, 0, BLUR_SIDE, BLUR_SIDE);
    gl.useProgram(blur.made);
    bindTextures(gl, uniforms, { picture: target.texture });
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.generateMipmap(gl.TEXTURE_2D);
    const shown = [0, 1].map((k) => Math.max(frame[k], 0));
    const end = [2, 3].map((k) => Math.min(frame[k], 1));
    gl.uniform4f(uniforms.frame, ...shown, ...end);
    gl.uniform3fv(uniforms.ground, ground);
    gl.uniform1f(
      uniforms.level,
      Math.log2(Math.max((end[0] - shown[0]) * target.width, (end[1] - shown[1]) * target.height) / BLUR_SIDE),
    );
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, share);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  }

  // Gaussians from one place in the order to another, under what is there, but where a pixel is closed.
  #paint(from, to, width, height) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.depthMask(false);
    gl.depthFunc(gl.LESS);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.DST_ALPHA, gl.ONE, gl.ZERO, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.paint.made);
    bindTextures(gl, this.paint.uniforms, this.records);
    gl.uniform2f(this.paint.uniforms.size, width, height);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 3 * from, 3 * (to - from));
    gl.disable(gl.BLEND);
  }

  // Closes the dark pixels, at the depth of all triangles.
  #close() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.closed.frame);
    gl.depthMask(true);
    gl.depthFunc(gl.ALWAYS);
    gl.useProgram(this.close.made);
    bindTextures(gl, this.close.uniforms, { picture: this.target.texture });
    gl.uniform1f(this.close.uniforms.most, DARK);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #projectAll(view, eye, width, height, options) {
    const { gl } = this;
    const { uniforms } = this.project;
    gl.useProgram(this.project.made);
    this.#fillShares(options.shares);
    bindTextures(gl, uniforms, { ...this.textures, shares: this.shares });
    gl.uniform1ui(uniforms.count, this.sortedCount);
    gl.uniformMatrix3fv(uniforms.projection, true, view.projection);
    gl.uniform3fv(uniforms.eye, eye);
    gl.uniform2fv(uniforms.principal, view.principal);
    gl.uniform2f(uniforms.size, width, height);
    gl.uniform1f(uniforms.nearPlane, options.nearPlane);
    gl.uniform2fv(uniforms.logSteps, this.cloud.logSteps);
    gl.uniform1f(uniforms.focal, view.focal);
    gl.uniform1i(uniforms.fades, options.fades ? 1 : 0);
    gl.uniform1f(uniforms.leastOpacity, options.leastOpacity);
    gl.uniform1i(uniforms.functions, this.cloud.functions);
    gl.uniform3f(uniforms.depths, 1 / this.cloud.nearest, 1 / this.cloud.farthest, options.depth ? 1 : 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.recordFrame);
    gl.viewport(0, 0, TEXTURE_WIDTH, Math.ceil(this.sortedCount / TEXTURE_WIDTH));
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #fillShares(shares) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.shares);
    const views = shares.length / 2 + 1;
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, views, 1, gl.RG, gl.FLOAT, Float32Array.of(0, 1, ...shares));
  }

  #resize(width, height) {
    const { gl, target, closed } = this;
    if (target.width === width && target.height === height) return;
    Object.assign(target, { width, height });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    const [inner, kind] = this.isHalf ? [gl.RGBA16F, gl.HALF_FLOAT] : [gl.RGBA8, gl.UNSIGNED_BYTE];
    gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, gl.RGBA, kind, null);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.bindRenderbuffer(gl.RENDERBUFFER, closed.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT16, width, height);
    for (const { frame } of [target, closed]) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, closed.depth);
    }
    gl.drawBuffers([gl.NONE]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.texture, 0);
  }
}
