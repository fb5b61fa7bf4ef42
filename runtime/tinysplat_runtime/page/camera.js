// The camera of the page. OpenCV axes: x right, y down, z forward.
import { add, clamp, cross, dot, length, mix, scaled, turned } from "./vectors.js";

const LEAST_HEIGHT = 0.05; // radians that the direction of view keeps from straight up and down

export class Camera {
  K;
  width;
  height;
  reach;
  zoom;
  // view: {K: [fx, skew, fy, cx, cy], width, height, rotation: rows right, down, forward; position}
  constructor(view, reach) {
    this.set(view, reach);
  }

  set(view, reach, zoom = 1) {
    Object.assign(this, { K: view.K, width: view.width, height: view.height, reach, zoom });
    this.rotation = view.rotation.map((row) => [...row]);
    this.position = [...view.position];
  }

  // What a window shows: the view's own picture as large as fits, times `zoom`, and more around it.
  fitted(width, height) {
    const scale = Math.min(width / this.width, height / this.height) * this.zoom;
    const [fx, skew, fy, cx, cy] = this.K.map((value) => value * scale);
    const [x, y, z] = this.rotation;
    const principal = [width / 2 + cx - (scale * this.width) / 2, height / 2 + cy - (scale * this.height) / 2];
    const projection = [...add(scaled(x, fx), y, skew), ...scaled(y, fy), ...z];
    return { principal, focals: [fx, fy], focal: Math.sqrt(fx * fy), projection };
  }

  // The direction of what a window shows at a pixel, as long as it takes to be 1 deep.
  ray(x, y, width, height) {
    const { principal, focals } = this.fitted(width, height);
    const [right, down, forward] = this.rotation;
    return add(add(forward, right, (x - principal[0]) / focals[0]), down, (y - principal[1]) / focals[1]);
  }

  // Where points of the page show in a window: of each its pixel x and y, and its depth.
  shown(width, height) {
    const { projection, principal } = this.fitted(width, height);
    const [across, down, ahead] = [0, 3, 6].map((at) => projection.slice(at, at + 3));
    return (point) => {
      const ray = add(point, this.position, -1);
      const z = dot(ahead, ray);
      return [dot(across, ray) / z + principal[0], dot(down, ray) / z + principal[1], z];
    };
  }

  get target() {
    return add(this.position, this.rotation[2], this.reach);
  }

  turn(axis, angle, about) {
    this.rotation = this.rotation.map((row) => turned(row, axis, angle));
    if (about) this.position = add(about, turned(add(this.position, about, -1), axis, angle));
  }

  // Turns to the left and downwards by angles, about a point or on the spot.
  swing(up, left, down, about) {
    this.turn(up, left, about);
    const height = Math.acos(clamp(dot(this.rotation[2], up), -1, 1));
    const angle = clamp(down, LEAST_HEIGHT - height, Math.PI - LEAST_HEIGHT - height);
    const side = cross(this.rotation[2], up);
    const wide = length(side);
    this.turn(wide > 1e-6 ? scaled(side, 1 / wide) : this.rotation[0], -angle, about);
  }

  shift(right, down, forward) {
    const [x, y, z] = this.rotation;
    this.position = add(add(add(this.position, x, right), y, down), z, forward);
  }

  // Towards a point, or away from it where share < 0.
  approach(point, share) {
    this.position = mix(this.position, point, share);
    this.reach = Math.max(this.reach * (1 - share), 1e-3);
  }
}
