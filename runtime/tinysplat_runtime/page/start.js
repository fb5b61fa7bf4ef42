// The page's first script: unpacks the others, which lie in it as gzip, and starts them.
const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#:%/()*+-;,=.?@^_[{|}~";
const VALUES = new Uint8Array(128);
[...DIGITS].forEach((digit, value) => {
  VALUES[digit.charCodeAt(0)] = value;
});

function bytesOf(id) {
  // of base 85: five digits are four bytes, the last ones as many less as are missing
  const text = document.getElementById(id).textContent;
  const groups = Math.ceil(text.length / 5);
  const words = new DataView(new ArrayBuffer(4 * groups));
  for (let group = 0, at = 0; group < groups; group++) {
    let word = 0;
    for (let i = 0; i < 5; i++, at++) word = 85 * word + (at < text.length ? VALUES[text.charCodeAt(at)] : 84);
    words.setUint32(4 * group, word);
  }
  return new Uint8Array(words.buffer, 0, 4 * groups - ((5 - (text.length % 5)) % 5));
}

const text = new Response(new Blob([bytesOf("code")]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
const load = (code) => import(URL.createObjectURL(new Blob([code], { type: "text/javascript" })));
text
  .then(JSON.parse)
  .then(async ([decoder, page, story]) =>
    (await load(page)).start(await load(decoder), bytesOf("file"), story && (await load(story))),
  )
  .catch((error) => {
    document.getElementById("status").textContent = `This page cannot start: ${error.message}`;
    document.getElementById("blocked")?.remove();
  });
