// A view as an address has it, `#view=x,y,z,right,up,roll,zoom`: where the camera is in the file's world, how many
// degrees it is turned to the right and upwards from looking along z with y down, and about its own axis; the last two
// may be left out. Every page of the same scene reads it, whatever else it shows.
import { add, clamp, cross, dot, scaled } from "./vectors.js";

const DIGITS = 4; // of a place, beside how far away what it shows is
const DEGREE = Math.PI / 180;

// A camera that is turned to the right and upwards alone: rows right, down and forward.
function level(across, up) {
  const [c, s] = [Math.cos(across), Math.sin(across)];
  const right = [c, 0, -s];
  const forward = [s * Math.cos(up), -Math.sin(up), c * Math.cos(up)];
  return [right, cross(forward, right), forward];
}

// frame: scene.js; depth: how far away what the camera shows is, in the page's units.
export function viewText({ position, rotation: [right, , forward], zoom }, { scale, centre }, depth) {
  const digits = clamp(DIGITS - 1 - Math.floor(Math.log10(depth / scale)), 0, 12);
  const across = Math.atan2(forward[0], forward[2]);
  const up = Math.asin(clamp(-forward[1], -1, 1));
  const rows = level(across, up);
  const roll = Math.atan2(dot(right, rows[1]), dot(right, rows[0]));
  const turns = [across, up, roll].map((angle) => Number((angle / DEGREE).toFixed(2)));
  const numbers = [
    ...add(centre, position, 1 / scale).map((x) => Number(x.toFixed(digits))),
    ...turns,
    Number(zoom.toFixed(2)),
  ];
  return (turns[2] || zoom > 1.005 ? numbers : numbers.slice(0, 5)).join(",");
}

// What such a text means: { position, rotation, zoom }, or undefined where it means nothing.
export function viewFrom(text, { scale, centre }) {
  const numbers = (text || "none").split(",").map(Number);
  const [x, y, z, across, up, roll = 0, zoom = 1] = numbers;
  if (numbers.length < 5 || !numbers.every(Number.isFinite) || !(zoom >= 1 && zoom <= 10)) return undefined;
  const [right, down, forward] = level(DEGREE * across, DEGREE * up);
  const c = Math.cos(DEGREE * roll);
  const s = Math.sin(DEGREE * roll);
  return {
    position: scaled(add([x, y, z], centre, -1), scale),
    rotation: [add(scaled(right, c), down, s), add(scaled(down, c), right, -s), forward],
    zoom,
  };
}
