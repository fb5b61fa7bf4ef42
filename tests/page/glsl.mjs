// GLSL of scalars and constructors as JavaScript: types go.
const TYPE = "(?:float|vec2|vec3|vec4)";
const vector = (x, y, z, w) => ({ x, y, z, w });

// Functions and constants of arithmetic.js by name.
export function functionsOf(text) {
  const script = text
    .replace(
      new RegExp(`^${TYPE} (\\w+)\\(([^)]*)\\) \\{`, "gm"),
      (_, name, given) => `function ${name}(${given.replace(new RegExp(`${TYPE} `, "g"), "")}) {`,
    )
    .replace(new RegExp(`const ${TYPE} `, "g"), "const ")
    .replace(new RegExp(`\\b${TYPE} (\\w+) =`, "g"), "let $1 =");
  const names = [...script.matchAll(/^(?:function|const) (\w+)/gm)].map(([, name]) => name);
  return new Function("vec2", "vec3", "vec4", "max", "sqrt", `${script}\nreturn { ${names.join()} };`)(
    vector,
    vector,
    vector,
    Math.max,
    Math.sqrt,
  );
}

// The values of all basis functions along (x, y, z).
export function basisOf(glsl, places) {
  return Array.from({ length: 25 }, (_, n) => {
    const basis = glsl[`Y${n}`];
    const wanted = basis
      .toString()
      .match(/\(([^)]*)\)/)[1]
      .split(",")
      .map((name) => places[name.trim()]);
    return basis(...wanted);
  });
}
