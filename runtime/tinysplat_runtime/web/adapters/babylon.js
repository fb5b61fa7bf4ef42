/** A loader plug-in of Babylon.js: `RegisterSceneLoaderPlugin(new TsplatLoader())`, then `ImportMeshAsync("f.tsplat", scene)`. */
import { AssetContainer } from "@babylonjs/core/assetContainer.js";
import { GaussianSplattingMesh } from "@babylonjs/core/Meshes/GaussianSplatting/gaussianSplattingMesh.js";
import { decode } from "../tsplat.js";

const SH_C0 = 0.28209479177387814;
const ROW_BYTES = 32;

/** What the engine takes: rows of the `.splat` format, and bytes of SH coefficients, 16 a texture. */
function rowsOf({ count, degree, means, quats, scales, opacities, sh }, textureWidth) {
  const rows = new ArrayBuffer(ROW_BYTES * count);
  const [floats, bytes] = [new Float32Array(rows), new Uint8ClampedArray(rows)];
  const stride = 3 * (degree + 1) ** 2;
  const size = 16 * textureWidth * Math.ceil(count / textureWidth);
  const textures = Array.from({ length: Math.ceil((stride - 3) / 16) }, () => new Uint8ClampedArray(size));
  for (let i = 0; i < count; i++) {
    floats.set(means.subarray(3 * i, 3 * i + 3), 8 * i);
    floats.set(scales.subarray(3 * i, 3 * i + 3), 8 * i + 3);
    const at = ROW_BYTES * i + 24;
    for (let c = 0; c < 3; c++) bytes[at + c] = 255 * (0.5 + SH_C0 * sh[stride * i + c]);
    bytes[at + 3] = 255 * opacities[i];
    for (let c = 0; c < 4; c++) bytes[at + 4 + c] = 127.5 + 127.5 * quats[4 * i + c];
    for (let j = 0; j < stride - 3; j++) textures[j >> 4][16 * i + (j & 15)] = 127.5 + 127.5 * sh[stride * i + 3 + j];
  }
  return { rows, textures: textures.map(({ buffer }) => new Uint8Array(buffer)) };
}

export class TsplatLoader {
  name = "tsplat";
  extensions = { ".tsplat": { isBinary: true } };

  async importMeshAsync(_names, scene, data) {
    const decoded = await decode(data);
    const { rows, textures } = rowsOf(decoded, scene.getEngine().getCaps().maxTextureSize);
    const mesh = new GaussianSplattingMesh("tsplat", null, scene);
    mesh.updateData(rows, textures, { flipY: false }, undefined, decoded.degree);
    const [x, y, z] = decoded.origin;
    // y is up in either kind of scene: two axes turn in a right-handed one, one is mirrored in a left-handed one.
    if (scene.useRightHandedSystem) mesh.rotation.x = Math.PI;
    else mesh.scaling.y = -1;
    mesh.position.set(x, -y, scene.useRightHandedSystem ? -z : z);
    const nothing = { particleSystems: [], skeletons: [], animationGroups: [], transformNodes: [], geometries: [] };
    return { meshes: [mesh], lights: [], spriteManagers: [], ...nothing };
  }

  async loadAsync(scene, data) {
    await this.importMeshAsync(null, scene, data);
  }

  async loadAssetContainerAsync(scene, data) {
    const container = new AssetContainer(scene);
    container.meshes.push(...(await this.importMeshAsync(null, scene, data)).meshes);
    container.removeAllFromScene();
    return container;
  }
}
