import type { AssetContainer } from "@babylonjs/core/assetContainer.js";
import type { ISceneLoaderAsyncResult, ISceneLoaderPluginAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import type { Scene } from "@babylonjs/core/scene.js";

/** A loader plug-in: `RegisterSceneLoaderPlugin(new TsplatLoader())`, then `ImportMeshAsync("f.tsplat", scene)`. */
export class TsplatLoader implements ISceneLoaderPluginAsync {
  readonly name: string;
  readonly extensions: { readonly ".tsplat": { readonly isBinary: true } };
  importMeshAsync(names: unknown, scene: Scene, data: unknown): Promise<ISceneLoaderAsyncResult>;
  loadAsync(scene: Scene, data: unknown): Promise<void>;
  loadAssetContainerAsync(scene: Scene, data: unknown): Promise<AssetContainer>;
}
