// What movements of a hand mean: kept near the views, or free.
import { elastic } from "./bound.js";
import { add, clamp, dot, length, mix } from "./vectors.js";

const BACK_SECONDS = 0.12; // of the spring
const CLOSEST = 0.4; // of its depth from the views, that is kept from a surface
const MOST_ZOOM = 4;
const DOLLY = 0.5; // of an approach that the camera moves; the rest is a longer lens

// Turns a camera so that a point shows at a pixel.
function aim(camera, up, point, x, y, width, height) {
  const angles = (v) => [0, 1].map((k) => Math.atan2(dot(v, camera.rotation[k]), dot(v, camera.rotation[2])));
  const [wanted, now] = [angles(camera.ray(x, y, width, height)), angles(add(point, camera.position, -1))];
  camera.swing(up, wanted[0] - now[0], now[1] - wanted[1]);
}

// Near the views: what is pulled beyond the bound (bound.js) springs back.
export class BoundMover {
  camera;
  bound;
  up;
  window;
  // window(): its [width, height].
  constructor(camera, bound, up, window) {
    Object.assign(this, { camera, bound, up, window });
  }

  #move(change) {
    // pulled beyond the bound less and less
    const { camera, bound } = this;
    const before = bound.strain(camera);
    change();
    this.#look(0.7); // the rest of the way back is the spring's
    bound.pull(camera, elastic(before, bound.strain(camera)));
    camera.K = bound.foot(camera).K;
  }

  #look(share) {
    // back to what the views show
    const [x, y] = this.bound.stray(this.camera, ...this.window());
    this.camera.swing(this.up, share * x, -share * y);
  }

  // Over a third of the window to the bound, and by as much to the side as the picture goes on there.
  turn(dx, dy) {
    const { camera, bound } = this;
    const [width, height] = this.window();
    const { focals } = camera.fitted(width, height);
    const rate = Math.min(1, (3 * bound.width) / bound.depth) / width;
    const scale = Math.min(width / camera.width, height / camera.height) * camera.zoom;
    const hidden = (whole, shown) => Math.max(scale * whole - shown, 0) / 2 / (0.4 * shown);
    this.#move(() => {
      camera.swing(this.up, -rate * dx, rate * dy, add(camera.position, camera.rotation[2], bound.depth));
      camera.swing(
        this.up,
        (dx * hidden(camera.width, width)) / focals[0],
        (-dy * hidden(camera.height, height)) / focals[1],
      );
    });
  }

  slide(dx, dy) {
    const [width, height] = this.window();
    const share = (0.25 * this.bound.depth) / this.camera.fitted(width, height).focal;
    this.#move(() => this.camera.shift(-dx * share, -dy * share, 0));
  }

  // By a factor, towards what shows at a pixel: `point`.
  near(factor, x, y, point) {
    const { camera, bound } = this;
    const [width, height] = this.window();
    const zoom = clamp(camera.zoom * factor, 1, MOST_ZOOM);
    const foot = bound.foot(camera);
    const depth = length(add(point, foot.position, -1));
    const now = length(add(point, camera.position, -1));
    const wanted = Math.max(now * (camera.zoom / zoom) ** DOLLY, Math.min(now, CLOSEST * depth));
    this.#move(() => {
      camera.zoom = zoom;
      camera.position = mix(camera.position, point, 1 - wanted / now);
      aim(camera, this.up, point, x, y, width, height);
    });
  }

  keys([right, down, forward, across, tilt], seconds, isFast) {
    const [width, height] = this.window();
    const pixels = seconds * (isFast ? 0.8 : 0.35) * width;
    if (right || across) this.turn(-pixels * (right + across), 0);
    if (down || tilt) this.turn(0, -pixels * (down + tilt));
    if (forward)
      this.near(Math.exp(seconds * forward * (isFast ? 1.5 : 0.6)), width / 2, height / 2, this.camera.target);
  }

  // A step of the spring; whether there is more to come.
  spring(seconds) {
    const { camera, bound } = this;
    const left = Math.exp(-seconds / BACK_SECONDS);
    if (bound.strain(camera) <= 1.001 && Math.hypot(...bound.stray(camera, ...this.window())) < 1e-3) return false;
    this.#look(1 - left);
    bound.pull(camera, Math.max(1, 1 + (bound.strain(camera) - 1) * left));
    return true;
  }
}

// Anywhere: orbits a point, or looks around on the spot.
export class FreeMover {
  camera;
  up;
  window;
  reach;
  flies;
  constructor(camera, up, window, reach) {
    Object.assign(this, { camera, up, window, reach, flies: false });
  }

  get #focal() {
    return this.camera.fitted(...this.window()).focal;
  }

  turn(dx, dy) {
    const [width] = this.window();
    if (this.flies) this.camera.swing(this.up, dx / this.#focal, -dy / this.#focal);
    else this.camera.swing(this.up, (-4 * dx) / width, (4 * dy) / width, this.camera.target);
  }

  slide(dx, dy) {
    const share = this.camera.reach / this.#focal;
    this.camera.shift(-dx * share, -dy * share, 0);
  }

  near(factor, x, y, point) {
    const { camera } = this;
    const away = length(add(point, camera.position, -1));
    const share = 1 - 1 / factor;
    if (share < 0 && away > 8 * this.reach) return; // so far that nothing can be seen
    camera.approach(point, share);
  }

  keys([right, down, forward, across, tilt], seconds, isFast) {
    const way = seconds * this.camera.reach * (isFast ? 1.5 : 0.4);
    const angle = seconds * (isFast ? 1.8 : 0.6);
    this.camera.shift(right * way, down * way, forward * way);
    this.camera.swing(this.up, -across * angle, tilt * angle);
  }

  spring() {
    return false;
  }
}
