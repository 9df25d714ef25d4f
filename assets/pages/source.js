// Whom the page asks: the server that it came from, or the record that it has in itself.
const serverSource = {
  async answer(what, options) {
    const got = await fetch(what, options);
    if (!got.ok) throw new Error(await got.text());
    return got;
  },
  async ask(what) { return (await this.answer(what)).json(); },
  async mesh(name) { return (await this.answer("mesh?name=" + encodeURIComponent(name))).arrayBuffer(); },
  // `then`: of a time that is over; the stamp is that of the picture.
  eye(arm, stamp, then) { return "eye?arm=" + encodeURIComponent(arm) + (then ? "&t=" : "&of=") + stamp; },
  press(action, value) {
    const body = JSON.stringify({ action, value });
    return this.answer("do", { method: "POST", body, headers: { "Content-Type": "application/json" } });
  },
};
async function inflated(text) {
  const packed = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return JSON.parse(await new Response(packed).text());
}
// The last of some rows, sorted by the time that `of` gives, at or before a time; else the first.
function lastAt(rows, time, of) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (of(rows[middle]) <= time + 1e-6) low = middle + 1; else high = middle;
  }
  return rows[Math.max(0, low - 1)];
}
// Answers as the server of `bt-replay` does, from what `bt-record export --html` has put into the page.
function keptSource(data) {
  const story = (of, time) => {
    const numeric = of !== null && Number.isFinite(Number(of));
    const then = numeric || time !== null ? lastAt(data.why.at, Number(numeric ? of : time), row => row[0]) : null;
    if (numeric) return then[1];
    const running = then === null || of === null ? [] : then[1].stories.filter(each =>
      each.status === "RUNNING" && (each.arm + ":" + each.leaf + "/").startsWith(of + "/"));
    return running.length ? { stories: running } : data.why.of[of === null ? "" : of];
  };
  const answers = {
    now: () => data.now,
    log: () => data.log,
    series: () => data.series,
    scene: given => data.scenes[given.get("generation")],
    at: given => lastAt(data.moments, Number(given.get("t")), moment => moment.time),
    why: given => story(given.get("of"), given.get("t")),
  };
  return {
    async ask(what) {
      const [name, query] = what.split("?"), found = answers[name](new URLSearchParams(query));
      if (found === undefined) throw new Error("this page has no answer to that");
      if (found.error) throw new Error(found.error);
      return found;
    },
    async mesh(name) { return bytes(data.meshes[name]); },
    eye(arm, stamp) {
      const pictures = data.pictures[arm] || [];
      return pictures.length ? "data:image/jpeg;base64," + lastAt(pictures, stamp, row => row[0])[1] : "data:,";
    },
    async press() { throw new Error("a record is only looked at"); },
  };
}
