// What tinysplat/viewer/viewer.js uses; `npm install && npm run build` writes tinysplat/viewer/libraries.js.gz.
export * as THREE from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
