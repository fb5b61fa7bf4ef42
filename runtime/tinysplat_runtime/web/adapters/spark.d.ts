import type { SplatMesh } from "@sparkjsdev/spark";
import type { Options, Scene } from "../tsplat.js";

/** A scene, as `decode` gives it, as a mesh of Spark: y is up as in three.js, and the origin is the mesh's place. */
export function splatsOf(scene: Scene): SplatMesh;

/** The scene at an address, as `splatsOf` gives it. */
export function loadTsplat(url: string, options?: Options): Promise<SplatMesh>;
