// What stands beside the scene: trees, reasons, signals, log, blackboards, cameras.
const get = id => document.getElementById(id);
const MARKS = { INVALID: "·", RUNNING: "▶", SUCCESS: "✔", FAILURE: "✘" };
const COLORS = [[0.9, 0.6, 0.0], [0.12, 0.37, 0.9], [0.8, 0.1, 0.5], [0.1, 0.6, 0.45], [0.5, 0.3, 0.8], [0.6, 0.4, 0.2]];
const colorOf = index => COLORS[index % COLORS.length];
const css = color => "rgb(" + color.map(x => Math.round(255 * x)).join(",") + ")";
function made(tag, kind, text, ...inside) {
  const element = document.createElement(tag);
  if (kind) element.className = kind;
  if (text !== undefined && text !== "") element.textContent = text;
  element.append(...inside);
  return element;
}
const seconds = time => Number(time).toFixed(2) + " s";

// ---- trees ----------------------------------------------------------------------------------
const rows = new Map();
function rowOf(arm, node, index, hands) {
  const key = arm.arm + ":" + node.path;
  if (!rows.has(key)) {
    const row = made("div"), stop = made("button", "break"), mark = made("span", "mark");
    const name = made("span", "name"), since = made("time"), bar = made("div", "bar", "", made("i"));
    const reason = made("div", "reason");
    stop.title = "hold the run when this node changes";
    stop.setAttribute("aria-label", "breakpoint on " + node.path);
    stop.onclick = event => { event.stopPropagation(); hands.toggle(node.path); };
    row.onclick = () => hands.choose(key);
    row.tabIndex = 0;
    row.onkeydown = event => { if (event.key === "Enter") hands.choose(key); };
    name.append(node.name);
    if (node.kind !== node.name.replace(/#\d+$/, "")) name.append(" ", made("span", "kind", node.kind));
    row.title = node.path + " [" + node.kind + "]: why?";
    mark.style.marginLeft = 0.9 * node.depth + "rem";
    row.append(stop, mark, name, since, bar, reason);
    rows.set(key, { row, stop, mark, since, bar, reason });
  }
  const { row, stop, mark, since, bar, reason } = rows.get(key);
  row.className = "node " + node.status + (hands.chosen === key ? " chosen" : "");
  stop.disabled = !hands.live;
  stop.className = "break" + (hands.breakpoints.includes(node.path) ? " set" : "");
  mark.textContent = node.halted ? "■" : MARKS[node.status];
  const lasts = node.status === "RUNNING" ? (hands.time - node.since).toFixed(1) + " s" : seconds(node.since);
  since.textContent = node.status === "INVALID" && !node.halted ? "" : lasts;
  bar.hidden = node.progress === null || node.status !== "RUNNING";
  bar.firstChild.style.width = 100 * (node.progress || 0) + "%";
  reason.hidden = !node.reason && !node.waiting;
  reason.textContent = node.reason || node.waiting;
  reason.className = "reason" + (node.reason ? "" : " waiting");
  return row;
}
function gripperText({ name, opening_m: opening, force_n: force, holds }) {
  const parts = [];
  if (opening !== null) parts.push((1000 * opening).toFixed(1) + " mm open");
  if (force !== null) parts.push(force.toFixed(1) + " N");
  parts.push(holds.length ? "holds " + holds.join(", ") : "holds nothing");
  return name.replace(/_/g, " ") + ": " + parts.join(", ");
}
function showTrees(arms, hands) {
  const shown = arms.flatMap((arm, index) => {
    const title = made("h2"), dot = made("span", "dot");
    dot.style.background = css(colorOf(index));
    title.append(dot, arm.arm, made("small", "", arm.robot + (arm.outcome ? ", " + arm.outcome : "")));
    const away = arm.nodes.length ? [] : [made("p", "empty", "not in the world")];
    const held = arm.gripper ? [made("p", "gripper", gripperText(arm.gripper))] : [];
    const guard = arm.guard ? [made("p", "guard", arm.guard)] : [];
    return [title, ...held, ...guard, ...arm.nodes.map(node => rowOf(arm, node, index, hands)), ...away];
  });
  get("trees").replaceChildren(...shown);
}

// ---- reasons --------------------------------------------------------------------------------
const worded = value => typeof value === "string" ? value
  : typeof value === "number" ? String(Number(value.toPrecision(6))) : JSON.stringify(value);
function listed(title, pairs) {
  if (!pairs.length) return [];
  const list = made("dl");
  for (const [name, value] of pairs) list.append(made("dt", "", name), made("dd", "", worded(value)));
  return [made("h2", "", title), list];
}
function storyOf(story) {
  const panel = made("div", "story"), code = story.code && story.code !== story.status ? " " + story.code : "";
  const when = story.ended_s === null ? "running at " + seconds(story.at_s) + ", for " +
    seconds(story.at_s - story.began_s) : story.status + code + " at " + seconds(story.at_s);
  panel.append(made("div", story.status, "", made("b", "mark", when), " " + story.arm + ": " + story.leaf + " ",
    made("span", "kind", story.place)));
  for (const cause of story.causes) {
    panel.append(made("p", "cause", cause.sentence));
    if (cause.remedy) panel.append(made("p", "remedy", cause.remedy));
  }
  if (story.reason && story.causes.every(cause => !cause.sentence.includes(story.reason))) {
    panel.append(made("p", "cause", "Its message: " + story.reason));
  }
  panel.append(...listed("From the root down", story.chain.map(link =>
    [link.status, link.path.split("/").pop() + (link.place ? "  (" + link.place + ")" : "")])));
  panel.append(...listed("Ports", Object.entries(story.ports)));
  panel.append(...listed("Keys", story.keys.map(key => [key.key, worded(key.value) + (key.leaf === null
    ? ", written by nobody" : ", written by " + key.leaf + " at " + seconds(key.time_s))])));
  panel.append(...listed("Numbers", Object.entries(story.numbers).slice(0, 16)));
  if (story.before.length) {
    panel.append(made("h2", "", "In the second before"), made("ul", "", "", ...story.before.map(text => made("li", "", text))));
  }
  return panel;
}
function showWhy(title, stories, close) {
  const shut = made("button", "", "×"), head = made("h3", "", title);
  shut.setAttribute("aria-label", "close");
  shut.onclick = () => { get("why").hidden = true; close(); };
  head.append(shut);
  const none = stories.length ? [] : [made("p", "empty", "Nothing has failed, and nothing is running.")];
  get("why").replaceChildren(head, ...none, ...stories.map(storyOf));
  get("why").hidden = false;
}

// ---- signals --------------------------------------------------------------------------------
// Rows of an arm: time, tool x y z in m, error in degrees, share of torque, opening in m, force in N, and
// which stay of the arm in the world it is: curves are interrupted where it was spawned again.
const LIFE = 8;
const SIGNALS = [
  { name: "tool speed", unit: "m/s", of: (row, before) => {
    const passed = before && before[LIFE] === row[LIFE] ? row[0] - before[0] : 0;
    return passed > 0 ? Math.hypot(row[1] - before[1], row[2] - before[2], row[3] - before[3]) / passed : 0;
  } },
  { name: "joint error", unit: "°", of: row => row[4] },
  { name: "most used motor", unit: "%", of: row => 100 * row[5] },
  { name: "gripper opening", unit: "mm", of: row => 1000 * row[6], known: row => Number.isFinite(row[6]) },
  { name: "gripper force", unit: "N", of: row => Math.abs(row[7]), known: row => Number.isFinite(row[7]) },
];
for (const signal of SIGNALS) {
  const plot = made("canvas"), valueLabel = made("span");
  const caption = made("figcaption", "", "", made("span", "", signal.name + " (" + signal.unit + ")"), valueLabel);
  Object.assign(signal, { plot, valueLabel, figure: made("figure", "", "", caption, plot) });
  get("signals").append(signal.figure);
}
function niceTop(value) {
  const power = 10 ** Math.floor(Math.log10(value || 1));
  return [1, 2, 5, 10].map(x => x * power).find(x => x >= value) || 1;
}
function showSignals(tracks, names, until, now, failures) {
  if (get("signals").hidden) return;
  const from = 0;
  for (const { plot, valueLabel, of, known, figure } of SIGNALS) {
    const all = names.map(name => (tracks.get(name) || []).filter(row => row[0] <= until && (!known || known(row))));
    figure.hidden = Boolean(known) && all.every(curve => !curve.length);
    if (figure.hidden) continue;
    const ratio = window.devicePixelRatio || 1, wide = plot.clientWidth, high = plot.clientHeight;
    if (!wide || !high) continue;
    plot.width = wide * ratio;
    plot.height = high * ratio;
    const pen = plot.getContext("2d"), left = 34, low = high - 14, style = getComputedStyle(document.body);
    pen.scale(ratio, ratio);
    // No more points than there are pixels.
    const curves = all.map(curve => {
      const every = Math.ceil(curve.length / (1.5 * wide));
      return every > 1 ? curve.filter((_, i) => i % every === 0 || i === curve.length - 1) : curve;
    });
    const values = curves.map(curve => curve.map((row, i) => of(row, curve[i - 1])));
    const top = niceTop(Math.max(1e-6, ...values.map(each => each.reduce((a, b) => Math.max(a, b), 0))));
    const x = time => left + (wide - left - 4) * (time - from) / Math.max(0.1, until - from);
    const y = value => low - (low - 9) * Math.min(1, value / top);
    pen.font = "10px system-ui";
    pen.fillStyle = style.getPropertyValue("--soft");
    pen.strokeStyle = style.getPropertyValue("--edge");
    pen.textAlign = "right";
    for (const share of [0, 0.5, 1]) {
      pen.fillText(String(Number((share * top).toPrecision(3))), left - 5, y(share * top) + 3);
      pen.beginPath(); pen.moveTo(left, y(share * top)); pen.lineTo(wide - 4, y(share * top)); pen.stroke();
    }
    pen.textAlign = "center";
    const every = niceTop((until - from) / 6);
    for (let time = Math.ceil(from / every) * every; time <= until; time += every) {
      pen.fillText(Number(time.toPrecision(6)) + " s", Math.min(wide - 14, x(time)), high - 2);
    }
    pen.strokeStyle = style.getPropertyValue("--bad");
    pen.globalAlpha = 0.45;
    for (const { time } of failures) {
      pen.beginPath(); pen.moveTo(x(time), 6); pen.lineTo(x(time), low); pen.stroke();
    }
    pen.globalAlpha = 1;
    const shown = [];
    curves.forEach((curve, index) => {
      pen.strokeStyle = css(colorOf(index));
      pen.lineWidth = 1.4;
      pen.beginPath();
      curve.forEach((row, i) => {
        if (i && row[LIFE] !== curve[i - 1][LIFE]) pen.moveTo(x(row[0]), y(values[index][i]));
        pen.lineTo(x(row[0]), y(values[index][i]));
      });
      pen.stroke();
      const at = curve.findLastIndex(row => row[0] <= now + 1e-6);
      if (at >= 0) shown.push(made("b", "", values[index][at].toFixed(Math.max(0, 2 - Math.floor(Math.log10(top))))));
      if (at >= 0) shown.at(-1).style.color = css(colorOf(index));
    });
    valueLabel.replaceChildren(...shown.flatMap(each => [each, "  "]));
    pen.strokeStyle = style.getPropertyValue("--ink");
    pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(x(now), 4); pen.lineTo(x(now), low); pen.stroke();
    plot.onclick = event => window.goTo(from + (until - from) * (event.offsetX - left) / (wide - left - 4));
  }
}

// A mark on the time line for each time at which something failed; what failed is in its title.
function showFailures(failures, until) {
  const key = failures.length + " of " + until;
  if (showFailures.key === key) return;
  showFailures.key = key;
  const together = new Map();
  for (const { time, arm, text } of failures) together.set(time, [...(together.get(time) || []), arm + ": " + text]);
  get("marks").replaceChildren(...[...together].map(([time, texts]) => {
    const mark = made("button");
    mark.title = seconds(time) + "\n" + texts.join("\n");
    mark.setAttribute("aria-label", "failure at " + seconds(time));
    mark.style.left = "calc(8px + (100% - 16px) * " + Math.min(1, time / until) + ")";
    mark.onclick = () => window.goTo(time);
    return mark;
  }));
}

// ---- log, blackboards -----------------------------------------------------------------------
const MOST_LINES = 600;
function addLines(lines) {
  const log = get("log"), stuck = log.scrollTop + log.clientHeight > log.scrollHeight - 30;
  for (const { time, arm, text, level } of lines) {
    const line = made("div", level, "", made("span", "", seconds(time)), made("span", "", arm), made("span", level, text));
    line.dataset.time = time;
    line.title = "go to " + seconds(time);
    line.onclick = () => window.goTo(time);
    log.append(line);
  }
  while (log.childElementCount > MOST_LINES) log.firstChild.remove();
  if (stuck) log.scrollTop = log.scrollHeight;
}
function dimLog(now, past) {
  if (get("log").hidden) return;
  let last = null;
  for (const line of get("log").children) {
    const later = past && Number(line.dataset.time) > now + 1e-6;
    line.classList.toggle("later", later);
    if (!later) last = line;
  }
  if (past && last && dimLog.at !== now) last.scrollIntoView({ block: "nearest" });
  dimLog.at = now;
}
function showBoards(arms) {
  if (get("boards").hidden) return;
  const table = made("table"), keys = arms.flatMap(arm => (arm.board || []).map(key => [arm.arm, key]));
  table.append(made("tr", "", "", ...["arm", "key", "value", "written by", "at"].map(text => made("th", "", text))));
  for (const [arm, { key, value, leaf, time }] of keys) {
    table.append(made("tr", "", "", ...[arm, key, value, leaf, seconds(time)].map(text => made("td", "", text))));
  }
  get("boards").replaceChildren(keys.length ? table : made("p", "empty", "No node has written a key yet."));
}

// ---- cameras --------------------------------------------------------------------------------
const eyes = new Map();
function svg(tag, facts) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(facts)) element.setAttribute(name, value);
  return element;
}
// `source` gives the address of a camera's picture, which changes with the picture.
function showEyes(cameras, source, shown) {
  get("eyes").hidden = !shown;
  for (const [arm, { card }] of eyes) card.hidden = !cameras.some(camera => camera.arm === arm && camera.look);
  if (!shown) return;
  for (const { arm, look, size } of cameras.filter(camera => camera.look)) {
    if (!eyes.has(arm)) {
      const image = made("img"), marks = svg("svg", { viewBox: "0 0 " + size.join(" ") });
      const caption = made("p"), card = made("div", "eye", "", made("div", "", "", image, marks), caption);
      image.alt = "picture of the camera of " + arm;
      get("eyes").append(card);
      eyes.set(arm, { image, marks, caption, card });
    }
    const { image, marks, caption } = eyes.get(arm), address = source(arm, look.stamp);
    if (image.dataset.of !== address && (image.complete || !image.src)) {
      image.dataset.of = address;
      image.src = address;
    }
    const drawn = [];
    if (look.region && look.region.join() !== [0, 0, ...size].join()) {
      const [x, y, right, bottom] = look.region;
      const whole = "M0 0H" + size[0] + "V" + size[1] + "H0Z", part = "M" + x + " " + y + "H" + right + "V" + bottom + "H" + x + "Z";
      drawn.push(svg("path", { d: whole + part, "fill-rule": "evenodd", fill: "#10151b8c" }));
      drawn.push(svg("rect", { x, y, width: Math.max(0, right - x), height: Math.max(0, bottom - y),
        fill: "none", stroke: "#ffffffb0", "stroke-width": 1, "stroke-dasharray": "4 3" }));
    }
    if (look.pixel) {
      const [cx, cy] = look.pixel, r = Math.max(5, Math.sqrt((look.area_px || 0) / Math.PI) * 1.25);
      drawn.push(svg("circle", { cx, cy, r, fill: "none", stroke: look.locked ? "#35e07a" : "#ffc94d", "stroke-width": 2 }));
      drawn.push(svg("path", { d: `M${cx - 5} ${cy}h10M${cx} ${cy - 5}v10`, stroke: "#fff", "stroke-width": 1 }));
    }
    marks.replaceChildren(...drawn);
    const found = look.pixel ? "found, " + Math.round(look.area_px) + " px²" : look.pixel === null ? "nothing found" : "";
    caption.replaceChildren(made("span", "", arm + " at " + seconds(look.stamp)), made("span", "", found));
  }
}

// ---- lines in the scene ---------------------------------------------------------------------
// A frustum: from the eye to the corners of what it sees half a meter off.
function frustum({ eye, axes, half }, far = 0.35) {
  const corner = (x, y) => [0, 1, 2].map(i => eye[i] + far * (axes[3 * i] * x * half[0] + axes[3 * i + 1] * y * half[1] - axes[3 * i + 2]));
  const four = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
  return new Float32Array(four.flatMap((point, i) => [...eye, ...point, ...point, ...four[(i + 1) % 4]]));
}
// An arrow for each contact: 1 cm for each newton, at most 30 cm.
function arrows(contacts) {
  return new Float32Array(contacts.flatMap(({ point, force }) => {
    const size = Math.hypot(...force), long = Math.max(0.02, Math.min(0.3, 0.01 * size));
    return [...point, ...point.map((x, i) => x + long * force[i] / size)];
  }));
}
function crosses(contacts) {
  return new Float32Array(contacts.flatMap(({ point: [x, y, z] }) =>
    [x - 0.008, y, z, x + 0.008, y, z, x, y - 0.008, z, x, y + 0.008, z, x, y, z - 0.008, x, y, z + 0.008]));
}
function showTouches(contacts, shown) {
  const pairs = new Map();
  for (const { between, force } of contacts) {
    const name = between.join(" — ");
    pairs.set(name, (pairs.get(name) || 0) + Math.hypot(...force));
  }
  const lines = [...pairs].slice(0, 12).map(([name, newton]) => made("div", "", name + ": " + newton.toFixed(1) + " N"));
  get("touches").hidden = !shown;
  get("touches").replaceChildren(...(lines.length ? lines : [made("div", "", "nothing presses on anything")]));
}
