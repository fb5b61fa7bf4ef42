// The licence texts of the libraries in the bundle.
import { readFileSync, existsSync } from "node:fs";

for (const name of ["three", "@sparkjsdev/spark"]) {
  const folder = `node_modules/${name}`;
  const { version, license } = JSON.parse(readFileSync(`${folder}/package.json`, "utf8"));
  const file = ["LICENSE", "LICENSE.md"].map((n) => `${folder}/${n}`).find(existsSync);
  console.log(`${name} ${version} (${license})\n\n${file ? readFileSync(file, "utf8").trim() : license}\n`);
}
