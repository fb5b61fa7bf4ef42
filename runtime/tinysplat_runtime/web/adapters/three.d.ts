import type { GaussianSplat } from "three/addons/objects/GaussianSplat.js";
import type { Options, Scene } from "../tsplat.js";

/** A scene, as `decode` gives it, as an object of three.js: y is up as there, and the origin is the object's place. */
export function splatsOf(scene: Scene): GaussianSplat;

/** The scene at an address, as `splatsOf` gives it. */
export function loadTsplat(url: string, options?: Options): Promise<GaussianSplat>;
