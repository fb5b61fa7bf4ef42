/**
 * A generator for PlayCanvas' splat-transform, through which a `.tsplat` goes into all formats that it writes:
 *
 *     splat-transform splat-transform.mjs -p file=scene.tsplat scene.sog
 *
 * Coordinates are relative to the file's origin. A generator's y is up, which is half a turn about z from a file's: it
 * mirrors x and y, and with them the SH functions of odd m: every other one.
 */
import { readFile } from "node:fs/promises";
import { decode } from "../tsplat.js";

const MOST_DEGREE = 3;
const LEAST = 1e-30;

export class Generator {
  /** @param {{ name: string, value: string }[]} params */
  static async create(params) {
    const file = params.find(({ name }) => name === "file")?.value;
    if (!file) throw new Error("which file? -p file=scene.tsplat");
    return new Generator(await decode(await readFile(file)));
  }

  /** @param {import("../tsplat.js").Scene} scene */
  constructor(scene) {
    this.scene = scene;
    this.count = scene.count;
    this.rest = (Math.min(scene.degree, MOST_DEGREE) + 1) ** 2 - 1; // functions beyond the first
    const rest = Array.from({ length: 3 * this.rest }, (_, i) => `f_rest_${i}`);
    const scales = ["scale_0", "scale_1", "scale_2"];
    this.columnNames = [
      "x",
      "y",
      "z",
      "f_dc_0",
      "f_dc_1",
      "f_dc_2",
      ...rest,
      "opacity",
      ...scales,
      "rot_0",
      "rot_1",
      "rot_2",
      "rot_3",
    ];
  }

  /** @param {number} index @param {Record<string, number>} row */
  getRow(index, row) {
    const { means, quats, scales, opacities, sh, degree } = this.scene;
    const at = index * 3 * (degree + 1) ** 2;
    for (let i = 0; i < 3; i++) {
      row["xyz"[i]] = means[3 * index + i] * (i < 2 ? -1 : 1);
      row[`scale_${i}`] = Math.log(Math.max(scales[3 * index + i], LEAST));
      row[`f_dc_${i}`] = sh[at + i];
      for (let n = 0; n < this.rest; n++)
        row[`f_rest_${i * this.rest + n}`] = sh[at + 3 * (n + 1) + i] * (n % 2 ? 1 : -1);
    }
    const [w, x, y, z] = quats.subarray(4 * index, 4 * index + 4);
    [row.rot_0, row.rot_1, row.rot_2, row.rot_3] = [-z, -y, x, w];
    const opacity = Math.min(Math.max(opacities[index], 1e-7), 1 - 1e-7);
    row.opacity = Math.log(opacity / (1 - opacity));
  }
}
