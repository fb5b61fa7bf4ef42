// What a page with each adapter writes: `tsc --strict` has to take it.
import { ImportMeshAsync, RegisterSceneLoaderPlugin } from "@babylonjs/core/Loading/sceneLoader.js";
import type { Scene as BabylonScene } from "@babylonjs/core/scene.js";
import { Scene } from "three";
import { decode } from "tsplat";
import { TsplatLoader } from "tsplat/babylon";
import * as spark from "tsplat/spark";
import * as three from "tsplat/three";

export async function shown(address: string, bytes: ArrayBuffer, babylon: BabylonScene): Promise<number> {
  const scene = new Scene(), decoded = await decode(bytes);
  scene.add(three.splatsOf(decoded), await three.loadTsplat(address, { threads: 2 }), spark.splatsOf(decoded));
  const mesh = await spark.loadTsplat(address);
  mesh.position.set(0, 1, 0);
  RegisterSceneLoaderPlugin(new TsplatLoader());
  const { meshes } = await ImportMeshAsync(address, babylon);
  return meshes.length + decoded.count;
}
