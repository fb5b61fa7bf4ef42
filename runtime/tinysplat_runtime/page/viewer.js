// One scene in a canvas: its camera, what moves it, and a frame whenever something changed.
import { Bound, lightAt, onward, poseBetween, walk } from "./bound.js";
import { Camera } from "./camera.js";
import { Controls } from "./controls.js";
import { BoundMover, FreeMover } from "./movers.js";
import { distances, shares } from "./near.js";
import { Splats } from "./splats.js";
import { add, dot, length, scaled } from "./vectors.js";

const SLOW_MS = 45; // a frame that takes longer is drawn with fewer pixels while things move
const COARSEST = 0.25;
const STEP_SECONDS = 4; // from view to view, untouched
const FLIGHT_SECONDS = 0.7; // to a view that was asked for
const STALLED_MS = 200; // a coarsest frame that takes longer ends what moves by itself
const CARRY = 1.05; // strain from which a pull goes on to the next view
const PICK_PX = 8;
const WAIT_MS = 400; // that a picture may be old before a sign says so
const MOST_RATIO = 3; // pixels of a canvas to one of the page's
const FOLLOW = 0.12; // of margins, that a frame on the way to another place brings nearer to its own colours

export class Viewer {
  canvas;
  told;
  isBare;
  isStill;
  background;
  share;
  last;
  time;
  isFree;
  scene;
  cloud;
  splats;
  // canvas; told: { drawn, moved, touched, rested }, called after a frame, after movements, before the first of them,
  // and when all has come to rest.
  // isBare: pictures as the rasteriser's, and nothing moves by itself. background: colour where nothing is, if it is
  // told.
  constructor(canvas, told, { isBare, isEmbedded, isStill, background }) {
    Object.assign(this, {
      canvas,
      told,
      isBare,
      isStill,
      background,
      share: 1,
      last: 0,
      time: 0,
      isFree: false,
      showsDepth: false,
      leastOpacity: 0,
    });
    this.controls = new Controls(
      canvas,
      {
        mover: () => this.mover,
        moved: () => this.#moved(),
        point: (x, y) => this.pointAt(x, y),
        touched: () => this.#touch(),
        back: () => this.back(),
        picked: (x, y) => this.#picked(x, y),
        released: () => this.#carryOn(),
      },
      isEmbedded,
    );
    this.isSwinging = !isBare && !isStill;
    new ResizeObserver(() => {
      this.isDirty = true;
    }).observe(canvas);
    requestAnimationFrame((now) => this.#frame(now));
  }

  // scene: scene.js, cloud: cloud.js; keeps the camera where a sharper cloud of the same scene comes, and stands at the
  // view `first` otherwise.
  show(scene, cloud, isSame = false, first = 0) {
    this.splats ??= new Splats(this.canvas, () => {
      this.isDirty = true;
    });
    this.splats.load(cloud);
    Object.assign(this, { scene, cloud });
    this.isNew ||= !this.hasMoved; // margins follow a picture that gets better where it began
    this.#survey();
    if (!isSame) this.#stand(first);
    this.move();
  }

  #stand(first) {
    const { views, up, reach } = this.scene;
    const window = () => [this.canvas.clientWidth, this.canvas.clientHeight];
    this.camera = new Camera(views[first], reach);
    this.free = new FreeMover(this.camera, up, window, reach);
    this.near = this.bound && new BoundMover(this.camera, this.bound, up, window);
    this.current = this.start = first;
    this.time = STEP_SECONDS * this.order.indexOf(first);
    this.hasShown = this.hasMoved = false;
    this.flight = null;
    this.isDirty = true;
    this.#set(views[first], true);
    this.hasMoved = this.isOld = false;
  }

  // Ways between the views.
  #survey() {
    const { views, hasCameras } = this.scene;
    this.bound = hasCameras ? new Bound(views, this.cloud.depth, this.cloud.spread) : null;
    if (this.near) this.near.bound = this.bound;
    this.order = walk(views, this.cloud.depth);
    this.path = this.order.map((v) => views[v]);
  }

  // Nothing is shown any more.
  clear() {
    this.splats?.clear();
    this.hasShown = false;
  }

  // The device has lost what it was given: the picture stays until there is another.
  lose() {
    this.splats?.stop();
    this.splats = null;
    this.isNew = true;
  }

  // Whether a frame has to be drawn.
  get isDirty() {
    return this.hasChanged;
  }

  set isDirty(isDirty) {
    this.hasChanged = isDirty;
    if (isDirty) delete document.body.dataset.ready;
  }

  get mover() {
    return this.isFree || !this.near ? this.free : this.near;
  }

  // The canvas takes its new size when it is drawn, as that empties it.
  #resize() {
    const { canvas } = this;
    const ratio = this.isBare ? 1 : Math.min(devicePixelRatio, MOST_RATIO);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) =>
      Math.max(1, Math.round(side * ratio)),
    );
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
  }

  // isElsewhere: so far away that an order of before is none from there.
  #set(pose, isElsewhere = false, zoom = 1) {
    this.camera.set({ ...this.camera, ...pose }, this.scene.reach, zoom);
    this.hasMoved = this.isOld = true;
    this.isElsewhere ||= isElsewhere;
    this.isNew ||= isElsewhere;
    this.move();
  }

  // Goes to where view i was taken from.
  select(i, isAtOnce = this.isBare || this.isStill) {
    this.goTo(this.scene.views[i], isAtOnce);
    this.current = i;
    this.isAway = false;
  }

  // Goes to a camera's pose, at `zoom`.
  goTo(pose, isAtOnce = this.isBare || this.isStill, zoom = 1) {
    this.isSwinging = this.touched = false;
    this.flight = null;
    this.current = this.nearest(pose)[0];
    const { camera } = this;
    const { K, width, height } = camera;
    const to = { K, width, height, ...pose };
    const isFar = length(add(to.position, camera.position, -1)) > this.cloud.depth;
    if (isAtOnce || isFar) this.#set(to, true, zoom);
    else
      this.flight = { from: { ...camera, rotation: camera.rotation.map((row) => [...row]) }, pose: to, zoom, done: 0 };
  }

  back() {
    this.select(this.start);
    this.told.moved();
  }

  // To the view before or after in the order of a walk.
  step(by) {
    const { order } = this;
    const at = order.indexOf(this.current) + by;
    if (!this.flight && order[at] !== undefined) this.select(order[at]);
    this.told.moved();
  }

  // Pulled beyond the bound: on to the view that lies there.
  #carryOn() {
    if (!this.bound || this.isFree || this.flight || this.bound.strain(this.camera) < CARRY) return;
    const next = onward(this.scene.views, this.cloud.depth, this.camera, this.bound.foot(this.camera));
    if (next < 0) return;
    this.select(next);
    this.told.moved();
  }

  #touch() {
    this.flight = null;
    this.isSwinging = false;
    if (!this.touched) this.told.touched();
    this.touched = true;
  }

  swing(isAsked) {
    this.flight = null;
    this.isSwinging = isAsked;
    this.isAway = !isAsked;
    this.time = STEP_SECONDS * this.order.indexOf(this.current);
    this.told.moved();
  }

  // Distances as colours, in place of the scene's own.
  showDepth(isAsked) {
    this.showsDepth = isAsked;
    this.isDirty = true;
  }

  // Only Gaussians of at least this opacity.
  showOpaque(least) {
    this.leastOpacity = least;
    this.isDirty = true;
  }

  setFree(isFree) {
    this.isFree = isFree;
    if (!isFree && this.near) this.back();
    this.isDirty = true;
  }

  #moved() {
    this.isAway = this.hasMoved = this.isOld = true;
    if (this.near && !this.isFree) this.current = this.nearest()[0];
    this.told.moved();
    this.move();
  }

  // The camera has moved: Gaussians need another order.
  move() {
    if (!this.splats) return;
    if (this.splats.isSorted) this.#sort();
    else this.waits = true;
    this.isDirty = true;
  }

  #sort() {
    this.splats.sort(this.camera, this.scene.nearPlane, this.shares(), this.isElsewhere);
    this.waits = this.isElsewhere = false;
  }

  // Views, those nearest to a pose first.
  nearest(pose = this.camera) {
    const far = distances(this.scene.views, this.cloud.depth, pose);
    return far.map((_, v) => v).sort((a, b) => far[a] - far[b] || a - b);
  }

  shares() {
    const { viewCount, depth } = this.cloud;
    return shares(distances(this.scene.views.slice(0, viewCount), depth, this.camera));
  }

  // The point that shows at a pixel: on the nearest Gaussians there, or as deep as the scene where there are none.
  pointAt(x, y) {
    const { means, opacities, depth } = this.cloud;
    const { clientWidth, clientHeight } = this.canvas;
    const { camera } = this;
    const show = camera.shown(clientWidth, clientHeight);
    const depths = [];
    for (let i = 0; i < opacities.length; i++) {
      if (opacities[i] < 0.25) continue;
      const [u, v, z] = show(means.subarray(3 * i, 3 * i + 3));
      if (z > this.scene.nearPlane && (u - x) ** 2 + (v - y) ** 2 < PICK_PX ** 2) depths.push(z);
    }
    const found = depths.length ? depths.sort((a, b) => a - b)[depths.length >> 2] : depth;
    return add(camera.position, camera.ray(x, y, clientWidth, clientHeight), found);
  }

  #picked(x, y) {
    // freely: turns about that point from now on
    if (!this.isFree && this.near) return this.back();
    const { camera } = this;
    const to = add(this.pointAt(x, y), camera.position, -1);
    const [right, down, forward] = camera.rotation;
    camera.swing(
      this.scene.up,
      -Math.atan2(dot(to, right), dot(to, forward)),
      Math.atan2(dot(to, down), dot(to, forward)),
    );
    camera.reach = length(to);
    this.#moved();
  }

  drawing() {
    const { bound, isBare, showsDepth: depth } = this;
    const isNear = bound && !this.isFree;
    const strain = isNear && this.touched ? bound.strain(this.camera) : 0;
    const isFramed = isNear && !isBare && !depth && !this.background; // else its surroundings continue the picture
    return {
      nearPlane: this.scene.nearPlane,
      shares: this.shares(),
      depth,
      leastOpacity: this.leastOpacity,
      fades: !isBare && !depth,
      light: isBare ? 1 : lightAt(strain),
      ground: depth ? [0, 0, 0] : (this.background ?? (isBare ? [0, 0, 0] : this.cloud.ground)),
      isFramed,
      follow: this.isNew ? 1 : this.flight || this.isSwinging ? FOLLOW : 0,
    };
  }

  // From view to view and back, or a small circle about a single one.
  #swing(seconds) {
    const { path } = this;
    const legs = path.length - 1;
    this.time += seconds;
    if (legs > 0) {
      const turns = this.time / STEP_SECONDS / legs;
      const at = legs * (legs > 1 ? 1 - Math.abs(1 - (turns % 2)) : (1 - Math.cos(Math.PI * turns)) / 2);
      const leg = Math.min(Math.floor(at), legs - 1);
      return this.#set(poseBetween(path[leg], path[leg + 1], at - leg), false, this.camera.zoom);
    }
    const view = path[0];
    const angle = (Math.PI * this.time) / STEP_SECONDS;
    const wide = 0.7 * (this.bound?.side ?? 0.1 * this.scene.reach);
    const aside = add(
      scaled(view.rotation[0], wide * Math.sin(angle)),
      view.rotation[1],
      0.4 * wide * (Math.cos(angle) - 1),
    );
    this.#set({ position: add(view.position, aside), rotation: view.rotation }, false, this.camera.zoom);
  }

  #fly(seconds) {
    const { from, pose, zoom } = this.flight;
    const done = (this.flight.done = Math.min(this.flight.done + seconds / FLIGHT_SECONDS, 1));
    const t = done * done * (3 - 2 * done);
    this.#set(poseBetween(from, pose, t), false, from.zoom + t * (zoom - from.zoom));
    if (done === 1) this.flight = null;
  }

  // Whether anything moves in this frame.
  #step(seconds) {
    if (!this.flight) {
      this.controls.step(seconds);
      if (this.controls.holdsKeys) this.#carryOn();
    }
    if (this.flight) this.#fly(seconds);
    else if (this.isSwinging && this.hasShown) this.#swing(seconds);
    else if (!this.controls.isMoving && this.touched && this.mover.spring(seconds)) this.move();
    else return this.controls.isMoving;
    return true;
  }

  #frame(now) {
    requestAnimationFrame((next) => this.#frame(next));
    const elapsed = Math.min(now - this.last, 250);
    this.last = now;
    if (!this.splats) return;
    const moves = this.#step(elapsed / 1000);
    if (this.waits && this.splats.isSorted) this.#sort();
    if (this.isDirty || (!moves && this.share < 1)) {
      if (this.#isDrawable()) this.#draw(moves, elapsed);
      else if (this.isOld && now - this.drawnAt > WAIT_MS) this.#sign(true);
    }
    this.wasMoving = moves;
  }

  // Whether there is an order from about here. The picture before stays otherwise, beside a small sign.
  #isDrawable() {
    return this.splats.hasOrder && !this.isElsewhere;
  }

  #sign(isOld) {
    if (isOld) document.body.dataset.waits = "";
    else delete document.body.dataset.waits;
  }

  #draw(moves, elapsed) {
    if (!moves || this.isBare) this.share = 1;
    else if (elapsed > STALLED_MS && this.wasMoving && this.isSwinging && this.share === COARSEST) this.swing(false);
    else if (elapsed > SLOW_MS && this.wasMoving) this.share = Math.max(this.share / 2, COARSEST);
    this.isDirty = this.isOld = false;
    this.drawnAt = this.last;
    this.#sign(false);
    this.#resize();
    this.splats.draw(this.camera, this.drawing(), this.share);
    this.told.drawn(); // in an order that is at most a few frames old
    if (!this.splats.isSorted || this.waits) return;
    if (!moves) this.hasShown = true;
    this.isNew = false; // margins stay from now on
    if (this.share < 1 || moves) return;
    document.body.dataset.ready = "";
    this.told.rested?.();
  }
}
