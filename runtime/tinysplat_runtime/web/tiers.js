/** Mode list: docs/FORMAT.md, "Positions" and section 4, "Lists". Arithmetic is that of doubles, in the order stated. */
import { Cursor } from "./cursor.js";
import { require } from "./errors.js";
import { DETERMINING, MAX_LOG, orderOf } from "./list.js";
import { POSITIONS, unpackLzma2 } from "./lzma.js";
import { COLOR, ROTATION, channelName, intact } from "./table.js";

/** @typedef {import("./list.js").TierChannel} TierChannel */
/** @typedef {import("./list.js").List} List */
/** @typedef {import("./list.js").Tier} Tier */
/** @typedef {import("./synthesis.js").Arrays} Arrays */

const GROUPS = 4;
const ESCAPE = 255;
const LARGEST_TILE = 64;

/** Bits that are set, by byte. */
const PARTS = Uint8Array.from({ length: 256 }, (_, byte) => {
  let count = 0;
  for (; byte; byte &= byte - 1) count++;
  return count;
});

/**
 * Cells of the points, in their order: x, y and z of each.
 *
 * @param {Tier} tier
 * @param {Uint8Array} positions
 */
function decodeCells(tier, positions) {
  const { levels, leaves } = tier;
  const fields = new Cursor(positions, POSITIONS);
  const lengths = Array.from({ length: GROUPS + 2 }, () => fields.u32());
  const streams = lengths.map((length) => fields.take(length));
  fields.finish();
  const total = levels.reduce((sum, size) => sum + size, 0);
  const bytes = streams.slice(0, GROUPS).map((stream) => unpackLzma2(stream, total));
  const found = bytes.reduce((sum, stream) => sum + stream.length, 0);
  require(found === total, `${found} cells, announced are ${total}`, POSITIONS);
  const taken = new Array(GROUPS).fill(0);
  let nodes = new Uint32Array(3);
  let groups = Uint8Array.of(GROUPS - 1);
  levels.forEach((size, depth) => {
    const following = depth + 1 < levels.length ? levels[depth + 1] : leaves;
    const parts = new Uint32Array(3 * following);
    const partGroups = new Uint8Array(following);
    let at = 0;
    for (let cell = 0; cell < size; cell++) {
      const group = groups[cell];
      require(taken[group] < bytes[group].length, `stream ${group} ends in level ${depth}`, POSITIONS);
      const occupied = bytes[group][taken[group]++];
      const count = PARTS[occupied];
      require(count > 0, `an empty cell in level ${depth}`, POSITIONS);
      for (let part = 0; part < 8; part++) {
        if (!((occupied >> part) & 1)) continue;
        parts[3 * at] = 2 * nodes[3 * cell] + (part & 1);
        parts[3 * at + 1] = 2 * nodes[3 * cell + 1] + ((part >> 1) & 1);
        parts[3 * at + 2] = 2 * nodes[3 * cell + 2] + (part >> 2);
        partGroups[at++] = Math.min(count, GROUPS) - 1;
      }
    }
    require(at === following, `level ${depth + 1} does not have the cells announced`, POSITIONS);
    [nodes, groups] = [parts, partGroups];
  });
  return repeated(tier, streams, nodes);
}

/**
 * Leaves, each as often as there are points in it.
 *
 * @param {Tier} tier
 * @param {Uint8Array[]} streams
 * @param {Uint32Array} nodes
 */
function repeated({ leaves, escapes, count }, streams, nodes) {
  const further = unpackLzma2(streams[GROUPS], leaves);
  const large = unpackLzma2(streams[GROUPS + 1], 4 * escapes);
  const isWhole = further.length === leaves && large.length === 4 * escapes;
  require(isWhole, "points per cell are not those announced", POSITIONS);
  const numbers = new DataView(large.buffer, large.byteOffset, large.length);
  const cells = new Uint32Array(3 * count);
  let [at, escape] = [0, 0];
  for (let leaf = 0; leaf < leaves; leaf++) {
    let points = 1 + further[leaf];
    if (further[leaf] === ESCAPE) {
      require(escape < escapes, "points per cell are not those announced", POSITIONS);
      points = 1 + numbers.getUint32(4 * escape++, true);
    }
    require(points <= count - at, `more points than the ${count} announced`, POSITIONS);
    for (let i = 0; i < points; i++, at++) {
      for (let axis = 0; axis < 3; axis++) cells[3 * at + axis] = nodes[3 * leaf + axis];
    }
  }
  require(at === count && escape === escapes, `${at} points, announced are ${count}`, POSITIONS);
  return cells;
}

/** Side of a tile of the picture of `count` numbers. @param {number} count */
function tileSide(count) {
  let side = 16;
  while (side < LARGEST_TILE && side * side < count) side *= 2;
  return side;
}

/**
 * Height and width of the picture of a list of numbers.
 *
 * @param {number} count
 */
export function listShape(count) {
  const side = tileSide(count);
  const tiles = Math.ceil(count / (side * side));
  let across = Math.floor(Math.sqrt(tiles));
  while (across * across < tiles) across++;
  return { height: Math.ceil(tiles / across) * side, width: across * side };
}

/** Every other bit, from the lowest. @param {number} value of 12 bits */
function everyOther(value) {
  let found = 0;
  for (let bit = 0; bit < 6; bit++) found |= ((value >> (2 * bit)) & 1) << bit;
  return found;
}

/**
 * The list that a picture holds.
 *
 * @param {Uint16Array} plane
 * @param {number} count
 */
function fromPicture(plane, count) {
  const { width } = listShape(count);
  const side = tileSide(count);
  const places = new Uint32Array(side * side);
  for (let i = 0; i < places.length; i++) places[i] = everyOther(i >> 1) * width + everyOther(i);
  const list = new Uint16Array(count);
  const across = width / side;
  for (let at = 0, tile = 0; at < count; tile++) {
    const column = tile % across;
    const corner = ((tile - column) / across) * side * width + column * side;
    for (let i = 0; i < places.length && at < count; i++) list[at++] = plane[corner + places[i]];
  }
  return list;
}

/**
 * Places and gains of the Gaussians.
 *
 * @typedef {{ rows: Uint32Array | undefined, gains: Float64Array | undefined }} Order
 */

/**
 * The order by the first determinants: by class, and within one that of the points.
 *
 * @param {List} scene
 * @param {Float64Array[]} determinants
 * @returns {Order}
 */
function orderBy(scene, determinants) {
  const { thresholds } = scene;
  const count = determinants[0].length;
  const { first, gains } = scene.orders[determinants.length - 1];
  const classes = new Uint8Array(count);
  const starts = new Uint32Array(gains.length + 1);
  for (let i = 0; i < count; i++) {
    let reached = 0;
    determinants.forEach((values, n) => (reached += countReached(thresholds[n], values[i])));
    classes[i] = Math.min(Math.max((reached >> 1) - first, 0), gains.length - 1);
    starts[classes[i] + 1]++;
  }
  for (let i = 1; i <= gains.length; i++) starts[i] += starts[i - 1];
  const rows = new Uint32Array(count);
  for (let i = 0; i < count; i++) rows[starts[classes[i]]++] = i;
  return { rows, gains: Float64Array.from(classes, (number) => gains[number]) };
}

/**
 * How many of the rising thresholds a value reaches.
 *
 * @param {Float64Array} thresholds
 * @param {number} value
 */
function countReached(thresholds, value) {
  let [low, high] = [0, thresholds.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (value >= thresholds[middle]) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * A channel's numbers, by point.
 *
 * @param {TierChannel} channel
 * @param {Uint16Array | undefined} plane its picture; none of a constant
 * @param {Order} order
 * @param {number} count
 */
function channelValues(channel, plane, { rows, gains }, count) {
  const { scale, offset, centre } = channel;
  const values = new Float64Array(count);
  const list = plane && fromPicture(plane, count);
  for (let i = 0; i < count; i++) {
    const at = rows ? rows[i] : i;
    const coded = list ? list[i] * scale + offset : offset;
    values[at] = coded * (gains ? gains[at] : 1) + centre;
  }
  return values;
}

/**
 * How many Gaussians of a file are shown, and which tiers those are.
 *
 * @param {List} scene
 * @param {(stream: import("./table.js").Stream) => boolean} has whether a picture is at hand
 */
export function tiersShown(scene, has) {
  const isShown = scene.tiers.map(({ positions, channels }, number) => {
    const needed = channels.filter((channel) => channel.isCoded && channel.planeClass !== ROTATION);
    return has(positions) && (number === 0 || needed.every(({ streams }) => has(streams[0])));
  });
  const end = isShown.indexOf(false);
  const shown = scene.tiers.slice(0, end < 0 ? isShown.length : end);
  require(shown.length > 0, "holds no positions", "file");
  const growth = end < 0 ? 0 : scene.tiers[end].growth;
  return { shown, growth, count: shown.reduce((sum, tier) => sum + tier.count, 0) };
}

/**
 * The Gaussians of a tier.
 *
 * @param {List} scene
 * @param {Tier} tier
 * @param {number} growth
 * @param {(channel: TierChannel) => Promise<Uint16Array | undefined>} decode the picture of a channel; none where it is
 *   absent
 * @param {Arrays} out of all tiers
 * @param {number} first Gaussian of the tier
 */
export async function decodeTier(scene, tier, growth, decode, out, first) {
  const { count, channels } = tier;
  const end = first + count;
  const part = {
    count,
    degree: out.degree,
    means: out.means.subarray(3 * first, 3 * end),
    quats: out.quats.subarray(4 * first, 4 * end),
    scales: out.scales.subarray(3 * first, 3 * end),
    opacities: out.opacities.subarray(first, end),
    sh: out.sh.subarray(scene.mean.length * first, scene.mean.length * end),
  };
  placePoints(scene, tier.cell, decodeCells(tier, intact(tier.positions, POSITIONS)), part.means);
  /** @type {Record<string, Float64Array>} */
  const found = {};
  /** @type {Order[]} */
  const orders = [{ rows: undefined, gains: undefined }];
  const [determining, rest] = [true, false].map((isOne) =>
    channels.filter((channel) => DETERMINING.includes(channelName(channel)) === isOne),
  );
  for (const channel of determining) {
    const name = channelName(channel);
    const plane = channel.isCoded ? await decode(channel) : undefined;
    require(!channel.isCoded || plane !== undefined, `holds no intact picture of ${name}, which sorts others`, "file");
    found[name] = channelValues(channel, plane, orders[orders.length - 1], count);
    orders.push(
      orderBy(
        scene,
        DETERMINING.slice(0, orders.length).map((determinant) => found[determinant]),
      ),
    );
  }
  let isTurned = true;
  await Promise.all(
    rest.map(async (channel) => {
      const plane = channel.isCoded ? await decode(channel) : undefined;
      const isAbsent = channel.isCoded && plane === undefined;
      if (isAbsent && channel.planeClass === ROTATION) isTurned = false;
      const order = orders[orderOf(channel)];
      const values = isAbsent
        ? new Float64Array(count).fill(channel.centre)
        : channelValues(channel, plane, order, count);
      found[channelName(channel)] = values;
    }),
  );
  shapePoints(scene.middle, found, isTurned || scene.tiers.length === 1, growth, part);
  colourPoints(scene, channels, found, part.sh);
}

/**
 * Step 1.
 *
 * @param {List} scene
 * @param {number} cell
 * @param {Uint32Array} cells
 * @param {Float32Array} means
 */
function placePoints({ low, centre, radius }, cell, cells, means) {
  for (let i = 0; i < cells.length; i++) {
    const axis = i % 3;
    const u = low[axis] + cells[i] * cell;
    const far = Math.abs(u);
    means[i] = centre[axis] + radius * (far > 1 ? Math.sign(u) * Math.exp(far - 1) : u);
  }
}

/** @param {number} value @param {number} low @param {number} high */
function within(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/**
 * Steps 4 to 6.
 *
 * @param {number} middle
 * @param {Record<string, Float64Array>} found
 * @param {boolean} isTurned whether rotations are known, or these are spheres
 * @param {number} growth
 * @param {Arrays} out
 */
function shapePoints(middle, found, isTurned, growth, { count, opacities, scales, quats }) {
  const { opacity0, scale0, scale1, scale2, rotation0, rotation1, rotation2 } = found;
  for (let i = 0; i < count; i++) {
    opacities[i] = within(opacity0[i], 0, 1) ** 2;
    const v = scale0[i];
    const near = 2 * Math.log(within(v, 1 / 4, 16) / 2);
    let size = within(near + Math.min(v - 1 / 4, 0) * 8 + Math.max(v - 16, 0) / 8 + middle, -MAX_LOG, MAX_LOG);
    let [r, t] = [within(scale1[i], 0, MAX_LOG), within(scale2[i], 0, MAX_LOG)];
    if (!isTurned) [size, r, t] = [size - r / 6 - t / 3, 0, 0];
    [size + r / 2, size - r / 2, size - r / 2 - t].forEach((log, axis) => {
      scales[3 * i + axis] = Math.exp(within(log + growth, -MAX_LOG, MAX_LOG));
    });
    const [x, y, z] = [rotation0[i], rotation1[i], rotation2[i]];
    const squared = x * x + y * y + z * z;
    const w = Math.sqrt(Math.max(1 - squared, 0));
    const length = Math.sqrt(squared + w * w);
    quats[4 * i] = w / length;
    quats[4 * i + 1] = x / length;
    quats[4 * i + 2] = y / length;
    quats[4 * i + 3] = z / length;
  }
}

/**
 * Step 7.
 *
 * @param {List} scene
 * @param {TierChannel[]} channels
 * @param {Record<string, Float64Array>} found
 * @param {Float32Array} sh
 */
function colourPoints({ mean, basis, k }, channels, found, sh) {
  const count = sh.length / mean.length;
  const components = channels
    .filter((channel) => channel.planeClass === COLOR)
    .map((channel) => found[channelName(channel)]);
  for (let i = 0, at = 0; i < count; i++) {
    for (let row = 0; row < mean.length; row++) {
      let sum = mean[row];
      for (let column = 0; column < k; column++) sum += basis[row * k + column] * components[column][i];
      sh[at++] = sum;
    }
  }
}
