// Runs the script of an exported page on a stand-in for a browser; prints what it shows.
"use strict";
const fs = require("fs");
const page = fs.readFileSync(process.argv[2], "utf8");
const text = /<script type="application\/json" id="data">([\s\S]*?)<\/script>/.exec(page)[1];
const script = page.slice(page.lastIndexOf("<script>") + 8, page.lastIndexOf("</script>"));
const drawn = [];
const gl = new Proxy({}, {
  get: (_, name) => name === "drawArrays" ? (...a) => drawn.push(a)
    : name === "bufferData" ? (_t, array) => { if ([...array].some(Number.isNaN)) throw new Error("NaN"); }
    : /^[A-Z_0-9]+$/.test(String(name)) ? 1 : () => 1,
});
const elements = {};
function element() {
  const made = { style: {}, children: [], hidden: false, className: "", textContent: "", value: "1" };
  made.append = (...more) => made.children.push(...more);
  made.replaceChildren = (...more) => { made.children = more; };
  made.getContext = () => process.argv[3] === "nogl" ? null : gl;
  made.clientWidth = made.clientHeight = 300;
  return made;
}
const document = {
  getElementById: id => elements[id] ||= Object.assign(element(), id === "data" ? { textContent: text } : {}),
  createElement: element,
};
const window = { devicePixelRatio: 1 };
const requestAnimationFrame = () => 0;
new Function("document", "window", "requestAnimationFrame", script)(document, window, requestAnimationFrame);
const at = time => {
  elements.time.value = String(time);
  elements.time.oninput();
  const rows = elements.trees.children.filter(row => row.className);
  return rows.map(row => [row.className, row.children.at(-1).textContent]);
};
const shown = process.argv.slice(4).map(at);
console.log(JSON.stringify({ shown, drawn: drawn.length, why: elements.why.textContent,
  board: elements.board.children.map(row => row.children.map(cell => cell.textContent)) }));
