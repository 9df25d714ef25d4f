// The page itself: what is asked of the server, what is shown, what hands do.
const page = {
  kind: null, live: null, shown: null, past: null, until: 0, playing: false, scene: null, scenes: new Map(),
  meshes: {}, textures: {}, draw: null, chosen: null, breakpoints: [], tracks: new Map(), lines: 0, failures: [], isLive: false,
};
// By this name the server knows that the page is still open, however seldom it asks.
const NAME = Math.random().toString(36).slice(2) + Math.random().toString(36).slice(2);
let source = serverSource;
const ask = what => source.ask(what);
function press(action, value) {
  source.press(action, value).catch(error => { get("facts").textContent = error.message; });
}

// ---- the scene ------------------------------------------------------------------------------
// A mesh as `packed` of viewer/signals.py has it, as triangles with normals.
function unpacked(buffer) {
  const [count, faces] = new Uint32Array(buffer, 0, 2), box = new Float32Array(buffer, 8, 6);
  const at = new Uint16Array(buffer, 32, 3 * count), after = 32 + 6 * count, wide = count > 65536 ? 4 : 2;
  const corners = wide === 2 ? new Uint16Array(buffer, after, 3 * faces)
    : new Uint32Array(buffer.slice(after, after + 12 * faces));
  const normals = new Int8Array(buffer, after + 3 * wide * faces, 3 * count), triangles = new Float32Array(18 * faces);
  for (let i = 0, k = 0; i < 3 * faces; i++) {
    const corner = 3 * corners[i];
    for (let d = 0; d < 3; d++) triangles[k++] = box[d] + at[corner + d] / 65535 * box[3 + d];
    for (let d = 0; d < 3; d++) triangles[k++] = normals[corner + d] / 127;
  }
  return triangles;
}
async function sceneOf(generation) {
  if (!page.scenes.has(generation)) {
    page.scenes.set(generation, null);
    const scene = await ask("scene?generation=" + generation);
    await Promise.all(scene.meshes.filter(name => !page.meshes[name]).map(async name => {
      page.meshes[name] = unpacked(await source.mesh(name));
    }));
    Object.assign(page.textures, scene.textures);
    page.scenes.set(generation, scene);
    show();
  }
  return page.scenes.get(generation);
}
function waysShown(now) {
  const found = [];
  page.shown.arms.forEach((arm, index) => {
    const color = colorOf(index);
    if (get("ways").checked) {
      const lives = new Map();  // one trail for each stay in the world: it did not move in between
      for (const row of (page.tracks.get(arm.arm) || []).filter(row => row[0] <= now + 1e-6)) {
        if (!lives.has(row[LIFE])) lives.set(row[LIFE], []);
        lives.get(row[LIFE]).push(row);
      }
      for (const [life, rows] of lives) {
        const points = rows.flatMap(row => [row[1], row[2], row[3]]);  // samples are 40 ms apart:
        if (arm.tool && life === arm.life) points.push(...arm.tool);   // the last bit leads to the tool
        found.push([[...color, 0.9], new Float32Array(points), 2.2]);
      }
    }
    if (get("plans").checked && arm.ahead) found.push([[...color, 0.45], floats(arm.ahead), 4]);
  });
  if (get("frusta").checked) {
    page.shown.cameras.forEach(camera => found.push([[0.1, 0.14, 0.2, 0.7], frustum(camera), 1.3, true]));
  }
  if (get("forces").checked) {
    found.push([[0.85, 0.1, 0.15, 1], arrows(page.shown.contacts), 3, true]);
    found.push([[0.1, 0.1, 0.1, 1], crosses(page.shown.contacts), 1.6, true]);
  }
  return found;
}
// The middle of all bodies near the arms' tools, and how far off they are seen together.
function whatToSee() {
  const poses = floats(page.shown.poses), tools = page.shown.arms.filter(arm => arm.tool).map(arm => arm.tool);
  const points = [...tools];
  for (let i = 7; i < poses.length; i += 7) {
    const point = poses.slice(i, i + 3);
    if (!tools.length || tools.some(tool => Math.hypot(...minus(point, tool)) < 2)) points.push(point);
  }
  if (!points.length) return { middle: [0, 0, 0.4], far: 2.5 };
  const low = [0, 1, 2].map(i => Math.min(...points.map(point => point[i])));
  const high = [0, 1, 2].map(i => Math.max(...points.map(point => point[i])));
  const wide = Math.hypot(...minus(high, low));
  return { middle: low.map((x, i) => (x + high[i]) / 2), far: Math.max(1.6, Math.min(9, 1.25 * wide)) };
}
function drawScene() {
  const scene = page.scenes.get(page.shown.generation);
  if (!scene) { sceneOf(page.shown.generation).catch(lost); return; }
  if (page.draw === null) {
    const { middle, far } = whatToSee();
    page.draw = sceneOn(get("canvas"), page.meshes, page.textures, middle, show, far) || false;
    get("none").hidden = Boolean(page.draw);
  }
  if (page.draw) page.draw(scene.shapes, floats(page.shown.poses), waysShown(page.shown.time));
}

// ---- showing --------------------------------------------------------------------------------
function show() {
  if (!page.shown) return;
  const now = page.shown.time, isPast = page.past !== null, live = page.live;
  const hands = { live: page.kind === "live", time: now, chosen: page.chosen, breakpoints: page.breakpoints, choose, toggle };
  showTrees(page.shown.arms, hands);
  drawScene();
  const names = page.shown.arms.map(arm => arm.arm);
  showSignals(page.tracks, names, Math.max(page.until, 0.1), now, page.failures);
  showFailures(page.failures, Math.max(page.until, 0.1));
  showBoards(page.shown.arms);
  dimLog(now, isPast);
  const then = page.kind === "record" || isPast;
  showEyes(page.shown.cameras, (arm, stamp) => source.eye(arm, stamp, then), get("frusta").checked);
  showTouches(page.shown.contacts, get("forces").checked);
  get("time").max = page.until;
  get("time").value = now;
  const exact = page.kind === "live" && !isPast && live.held;
  get("now").textContent = now.toFixed(exact ? 3 : 2) + " s" + (page.kind === "record" || isPast ? " of " + page.until.toFixed(2) : "");
  get("live").hidden = page.kind === "record" || !isPast;
  const running = page.kind === "record" ? page.playing : !live.paused;
  get("go").textContent = page.kind === "record" ? (running ? "Pause" : "Play") : running ? "Pause" : "Go";
  const chip = page.kind === "record" ? ["RECORD", "past"] : isPast ? ["LOOKING BACK", "past"]
    : live.held ? ["HELD", "held"] : ["RUNNING", "running"];
  get("chip").textContent = chip[0];
  get("chip").className = "chip " + chip[1];
  if (page.kind === "live") get("facts").textContent = live.paused ? live.why : "";
}
function lost(error) {
  get("chip").textContent = source === serverSource ? "OVER" : "ERROR";
  get("chip").className = "chip lost";
  get("facts").textContent = source === serverSource
    ? "the run is over and its page closed, or it cannot be reached: " + error.message : error.message;
}

// ---- asking ---------------------------------------------------------------------------------
// Signals and trails are sampled by the run in simulated time: here they are only fetched.
async function readTracks() {
  const after = Math.max(0, ...[...page.tracks.values()].map(track => track.length ? track.at(-1)[0] : 0));
  const series = await ask("series?after=" + after), wide = series.columns.length;
  for (const [arm, text] of Object.entries(series.arms)) {
    const numbers = floats(text), track = page.tracks.get(arm) || [];
    const last = track.length ? track.at(-1)[0] : -1;
    for (let i = 0; i + wide <= numbers.length; i += wide) {
      if (numbers[i] > last) track.push([...numbers.subarray(i, i + wide)]);
    }
    page.tracks.set(arm, track.length > 12000 ? track.filter((_, i) => i % 2) : track);
  }
}
let asking = false, wanted = null;
// Shows the run at a time; of several times that are asked for meanwhile the last one.
async function goTo(time) {
  if (page.kind === "live" && !page.live.recorded) {
    get("facts").textContent = "there is no record of this run to go back in";
    return;
  }
  wanted = Math.max(0, Math.min(page.until, time));
  if (asking) return;
  asking = true;
  try {
    while (wanted !== null) {
      const asked = wanted;
      wanted = null;
      const moment = await ask("at?t=" + asked);
      page.past = asked;
      page.shown = moment;
      show();
    }
  } catch (error) {
    get("facts").textContent = error.message;
  } finally { asking = false; }
}
window.goTo = goTo;
async function look() {
  try {
    const now = await ask("now?page=" + NAME), first = page.kind === null;
    page.kind = now.kind;
    if (first) begin(now);
    if (now.kind === "record") { page.until = now.until; return; }
    page.live = now;
    page.breakpoints = now.breakpoints.slice();
    page.until = Math.max(page.until, now.time);
    if (page.past === null) page.shown = now;
    if (now.over && now.recorded) ended(now);
    show();
    if (page.kind === "live") setTimeout(look, 80);
  } catch (error) {
    lost(error);
    if (page.kind !== null) setTimeout(look, 1000);
  }
}
let following = false;
async function follow() {
  if (following) { setTimeout(follow, 100); return; }
  following = true;
  try {
    const reply = await ask("log?after=" + page.lines);
    page.lines = reply.next;
    page.failures = reply.failures;
    addLines(reply.lines);
    dimLog.at = null;
    await readTracks();
    show();
  } catch { /* `look` shows the error */ } finally { following = false; }
  if (page.kind !== "record") setTimeout(follow, 250);
}
// The run is over: its record is left to be looked at, as long as the page asks now and then.
function ended(now) {
  page.kind = "record";
  page.past = page.past === null ? now.time : page.past;
  buttons(true);
  get("facts").textContent = "the run is over; this is its record";
  setInterval(() => ask("now?page=" + NAME).catch(lost), 1000);
  follow();  // what came since it was last asked
}
function buttons(record) {
  for (const name of ["tick", "step"]) get(name).hidden = record;
  for (const name of ["back", "forth"]) get(name).hidden = !record;
  for (const element of document.querySelectorAll("#legend .held")) element.hidden = record;
  document.querySelector("[data-panel=stops]").hidden = record;
  if (record && get("speed").lastElementChild.value === "") get("speed").lastElementChild.remove();
}
function begin(now) {
  get("name").textContent = document.title = now.name;
  get("facts").textContent = now.facts || "";
  const record = now.kind === "record";
  buttons(record);
  page.isLive = !record;
  if (now.timestep) {
    const long = Number((1000 * now.timestep).toPrecision(4)) + " ms";
    get("timestep").textContent = long;
    get("step").title = "advance physics by one step, " + long + " of simulated time, and hold the run again (.)";
    get("tick").title = "go on until the trees have been ticked again, 50 times a simulated second unless the file " +
      "says otherwise, and hold the run again";
  }
  if (!now.recorded) get("time").disabled = get("ask").disabled = true;
  follow();
  const given = new URLSearchParams(location.hash.slice(1));
  if (given.has("tab")) open(given.get("tab"));
  if (given.has("forces")) get("forces").checked = true;
  page.until = now.until || now.time;
  if (record || given.has("t")) goTo(Number(given.get("t") || now.begin || 0));
  if (given.has("why")) setTimeout(() => choose(given.get("why")), 300);
  else if (now.begin) why(null, "Why?");
}

// ---- hands ----------------------------------------------------------------------------------
async function why(of, title, time) {
  try {
    const at = time === undefined ? "" : "&t=" + time;
    const reply = await ask("why" + (of === null ? "" : "?of=" + encodeURIComponent(of) + at));
    showWhy(title, reply.stories, () => { page.chosen = null; show(); });
  } catch (error) {
    const story = page.kind === "live" && !page.live.recorded ? "Reasons need a record: bt-run --record DIR." : error.message;
    showWhy(title, [], () => { page.chosen = null; show(); });
    get("why").lastChild.textContent = story;
  }
}
function choose(key) {
  page.chosen = key;
  show();
  why(key, key, page.shown ? page.shown.time : undefined);
}
function toggle(path) {
  const set = page.breakpoints.includes(path);
  page.breakpoints = set ? page.breakpoints.filter(name => name !== path) : [...page.breakpoints, path];
  get("breaks").value = page.breakpoints.join("\n");
  press("break", get("breaks").value);
  show();
}
let before = 0;
function play(stamp) {
  if (!page.playing) return;
  const time = page.past + (stamp - before) / 1000 * Number(get("speed").value);
  before = stamp;
  if (time >= page.until) page.playing = false;
  goTo(time).then(() => requestAnimationFrame(play));
}
function go() {
  if (page.kind === "live") {
    press(page.live.paused ? "go" : "pause");
    return;
  }
  page.playing = !page.playing;
  if (page.playing && page.past >= page.until) page.past = 0;
  before = performance.now();
  show();
  requestAnimationFrame(play);
}
function open(panel) {
  for (const tab of document.querySelectorAll("#tabs button")) {
    tab.setAttribute("aria-selected", tab.dataset.panel === panel);
    get(tab.dataset.panel).hidden = tab.dataset.panel !== panel;
  }
  show();
}
get("go").onclick = go;
get("tick").onclick = () => press("tick");
get("step").onclick = () => press("step");
get("back").onclick = () => goTo(page.past - 0.02);
get("forth").onclick = () => goTo(page.past + 0.021);
get("live").onclick = () => { page.past = null; page.shown = page.live; show(); };
get("ask").onclick = () => {
  const at = page.past === null ? null : page.shown.time.toFixed(3);
  page.chosen = null;
  why(at, at === null ? "Why?" : "What was going on at " + at + " s?");
};
get("help").onclick = () => get("legend").showModal();
get("speed").onchange = () => {
  if (page.kind === "live") press("speed", get("speed").value === "" ? null : Number(get("speed").value));
};
get("breaks").onchange = () => press("break", get("breaks").value);
get("time").oninput = () => { page.playing = false; goTo(Number(get("time").value)); };
for (const tab of document.querySelectorAll("#tabs button")) tab.onclick = () => open(tab.dataset.panel);
for (const layer of document.querySelectorAll("#layers input")) layer.onchange = show;
window.onkeydown = event => {
  if (event.target.matches("textarea, input, select, button")) return;
  const keys = { " ": go, ".": () => page.kind === "live" && press("step"),
    ArrowLeft: () => goTo(page.shown.time - 0.1), ArrowRight: () => goTo(page.shown.time + 0.1) };
  if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
};
window.onresize = show;
// A page that is closed sends a message: the command need not wait for it any longer.
window.onpagehide = () => {
  const left = JSON.stringify({ action: "leave", value: NAME });
  if (page.isLive) navigator.sendBeacon("do", new Blob([left], { type: "application/json" }));
};
async function start() {
  const kept = get("record");
  if (kept) source = keptSource(await inflated(kept.textContent));
  look();
}
start().catch(lost);
