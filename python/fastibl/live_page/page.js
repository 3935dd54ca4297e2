"use strict";
const VIEWS = { composite: "Composite", back: "Camera", front: "Front" };
const viewer = [...crypto.getRandomValues(new Uint8Array(8))].map((b) => b.toString(16).padStart(2, "0")).join("");
const $ = (id) => document.getElementById(id);
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const address = (path, query = {}) => `${path}?${new URLSearchParams({ ...query, viewer })}`;

// Text with `code` in it, as nodes: what the session says is never read as markup.
function fill(element, text) {
  element.replaceChildren(
    ...text.split("`").map((part, k) => (k % 2 ? make("code", part) : document.createTextNode(part))));
}
function make(tag, text = "", of = "") {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  if (of) element.className = of;
  return element;
}
function setText(element, text) { if (element.textContent !== text) element.textContent = text; }
function percent(x, digits = 2) { return x === null || x === undefined ? "–" : `${Number((100 * x).toPrecision(digits))} %`; }
function ms(x) { return x === null || x === undefined ? "–" : x < 0.005 ? "0" : x < 10 ? x.toFixed(2) : x.toFixed(1); }

// ---- What the server says when it does not answer.

function gone(title, text) {
  $("gone").hidden = !title;
  if (!title) return;
  setText($("gone").querySelector("h2"), title);
  setText($("gone").querySelector("p"), text);
}
async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch (error) {
    if (error.name !== "AbortError") gone("No connection", "fastibl live has ended, or cannot be reached. This page tries again.");
    throw error;
  }
  if (answer.status === 503 || answer.status === 403) {
    const text = await answer.text();
    gone(answer.status === 503 ? "No room" : "Not admitted", text);
    throw new Error(text);
  }
  gone("");
  return answer;
}

// ---- Changes.

const waiting = {}; // by control: until when the state does not overrule what was just set
let failure = "";

async function change(changes) {
  for (const name of Object.keys(changes)) waiting[name] = performance.now() + 1500;
  try {
    const answer = await ask(address("control"), {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(changes),
    });
    note(answer.ok ? "" : await answer.text());
  } catch { /* told by ask() */ }
}
async function savePicture() {
  try {
    const answer = await ask(address("save"), { method: "POST" });
    if (!answer.ok) note(await answer.text());
  } catch { /* told by ask() */ }
}
function note(text) { failure = text.trim(); showMessages(last?.messages ?? []); }
const settled = (name) => !(waiting[name] > performance.now());

// ---- The large picture: asked for again when it was drawn, so that a slow page skips pictures.

let view = "composite", shown = 0, axes = false, aborting = new AbortController();
const drawn = []; // when, in the last second
let taken = 0; // pictures drawn since the page was opened
let empty = false; // whether the view has no picture

function show(name) {
  view = name, shown = 0, empty = false;
  aborting.abort();
  for (const button of $("views").children) {
    const on = button.dataset.view === name;
    button.setAttribute("aria-checked", on), button.tabIndex = on ? 0 : -1;
  }
}
async function pictures() {
  for (;;) {
    if (document.hidden) { await sleep(200); continue; }
    aborting = new AbortController();
    try {
      const query = { after: shown, wait: 1, ...(axes ? { overlay: 1 } : {}) };
      const asked = view;
      const answer = await ask(address(`picture/${view}`, query), { signal: aborting.signal });
      if (answer.status !== 200) {
        if (answer.status === 204 && asked === view && !shown) clear();
        await sleep(50);
        continue;
      }
      const bitmap = await createImageBitmap(await answer.blob());
      if (asked !== view) continue;
      shown = Number(answer.headers.get("X-Picture"));
      draw($("picture"), bitmap);
      empty = false;
      drawOverlay(axes && answer.headers.get("X-Overlay"));
      const now = performance.now();
      drawn.push(now), taken++;
      while (now - drawn[0] > 1000) drawn.shift();
    } catch (error) {
      if (error.name !== "AbortError") await sleep(700);
    }
  }
}
function draw(canvas, bitmap) {
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
    canvas.width = bitmap.width, canvas.height = bitmap.height;
    if (canvas.id === "picture") $("screen").style.aspectRatio = `${bitmap.width} / ${bitmap.height}`;
  }
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  bitmap.close();
}
function clear() {
  const canvas = $("picture");
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  drawOverlay(null);
  empty = true;
}
function drawOverlay(header) {
  const canvas = $("overlay"), { width, height } = $("picture");
  if (canvas.width !== 2 * width || canvas.height !== 2 * height) canvas.width = 2 * width, canvas.height = 2 * height;
  const pen = canvas.getContext("2d");
  pen.setTransform(2, 0, 0, 2, 0, 0);
  pen.clearRect(0, 0, width, height);
  if (!header) return;
  const { axes: [origin, ...ends], shadow } = JSON.parse(header);
  const line = (points, colour, thick) => {
    if (points.flat().some((x) => x === null)) return;
    pen.beginPath();
    points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.strokeStyle = colour, pen.lineWidth = thick;
    pen.stroke();
  };
  pen.setLineDash([5, 4]);
  if (shadow.length) line([...shadow, shadow[0]], "rgba(255,255,255,.85)", 1.2);
  pen.setLineDash([]);
  ends.forEach((end, k) => line([origin, end], ["#ff5a4f", "#3ddc74", "#4fa3ff"][k], 3));
}

// ---- The small pictures.

async function small(name, canvas) {
  let after = 0;
  for (;;) {
    await sleep(document.hidden ? 1000 : 450);
    if (document.hidden) continue;
    try {
      const answer = await ask(address(`picture/${name}`, { after }));
      if (answer.status !== 200) continue;
      after = Number(answer.headers.get("X-Picture"));
      draw(canvas, await createImageBitmap(await answer.blob()));
    } catch { await sleep(700); }
  }
}

// ---- The numbers.

let last = null, choices = null;
const history = [];

async function states() {
  for (;;) {
    try {
      last = await (await ask(address("state"))).json();
      render(last);
    } catch { await sleep(700); }
    await sleep(document.hidden ? 1500 : 250);
  }
}
function render(s) {
  renderHead(s);
  renderHint(s);
  renderLight(s.light);
  renderControls(s.settings, s.preparing);
  renderPlan(s);
  showMessages(s.messages);
}
const STATE = { waiting: ["waiting", "warn"], running: ["running", "good"], frozen: ["frozen", ""], ended: ["ended", "warn"] };
function pill(element, text, kind) { setText(element, text); element.className = `pill ${kind}`; }
const isLate = (s) => s.picture > 0 && (s.state === "running" || s.state === "waiting") && s.age > 1.5;
function renderHead(s) {
  const late = isLate(s);
  const [text, kind] = late ? [`no picture for ${Math.round(s.age)} s`, "warn"] : STATE[s.state];
  pill($("state"), text, kind);
  const seen = s.board.seen;
  pill($("board"), seen ? `board ${s.board.metres.toFixed(2)} m away` : s.board.turned ? "by the surroundings" : "no board", seen ? "good" : "warn");
  setText($("source"), `${s.source}, ${s.size[0]} × ${s.size[1]}` + (s.dropped ? `, ${s.dropped} pictures skipped` : ""));
  const moving = s.state === "running" && !late;
  setText($("fps"), moving ? s.fps.toFixed(s.fps < 10 ? 1 : 0) : "–");
  setText($("total"), ms(s.milliseconds.total));
  setText($("error"), s.light ? percent(s.light.error) : "–");
  const millis = s.page.pictures ? (1000 * s.page.seconds) / s.page.pictures : 0;
  $("fps").parentElement.title = `this page shows ${drawn.length} a second; serving it takes ${millis.toFixed(2)} ms of processor time a picture; ${s.viewers} open`;
  $("frozen").hidden = s.state !== "frozen";
  $("recording").hidden = !s.recording;
  if (s.recording) setText($("recording"), `● ${s.recording.written} frames` + (s.recording.dropped ? `, ${s.recording.dropped} dropped` : ""));
}
const sentence = (text) => text && `${text[0].toUpperCase()}${text.slice(1)}.`;
let leftOut = 0; // since when pictures are left out
function renderHint(s) {
  let title = "", text = "";
  leftOut = s.left_out ? leftOut || performance.now() : 0;
  if (s.state === "waiting" && !s.picture) title = "Waiting for the first picture", text = sentence(s.left_out) || (s.messages.at(-1)?.text ?? sentence(s.reason));
  else if (empty && view === "front" && !s.front) title = "No front camera", text = "There are pictures of the back camera alone.";
  else if (empty && view === "front") title = "No picture of the front camera yet", text = "It is shown here as soon as one comes.";
  else if (s.state === "waiting" && isLate(s)) title = "Waiting for pictures", text = `${sentence(s.left_out || s.reason)} ${s.messages.at(-1)?.text ?? ""}`;
  else if (s.state === "running" && leftOut && performance.now() - leftOut > 3000) title = "Pictures are left out", text = sentence(s.left_out);
  else if (s.state === "ended") title = "The source has ended", text = `${sentence(s.reason)} Start anew begins again.`;
  else if (s.board.turned) title = "The board is out of view", text = "The surroundings tell how the cameras turn, so the light is still captured; turn back to see the object.";
  else if (!s.board.seen && s.picture) {
    title = "No board in view";
    text = s.board.advice || "Print it at 100 % with `fastibl board board.pdf`, lay it flat on the table and point the back camera at it, half a metre away.";
  }
  $("hint").hidden = !title;
  const key = title + text;
  if (!title || $("hint").dataset.key === key) return;
  $("hint").dataset.key = key;
  const body = make("span");
  fill(body, text);
  $("hint").replaceChildren(make("b", title), body);
}
// What is read out: where to look, once it has been elsewhere for some seconds.
let saidWay = "", newWay = "", newSince = 0;
function say(way) {
  const where = way.replace(/\d+/g, (degrees) => 30 * Math.round(degrees / 30));
  if (where !== newWay) newWay = where, newSince = performance.now();
  if (where === saidWay || performance.now() - newSince < 3000) return;
  saidWay = where;
  setText($("guidance-said"), way);
}
function renderLight(light) {
  if (!light) return;
  setText($("light").querySelector("h2").firstChild, light.given ? "Given light " : "Captured light ");
  setText($("coverage"), light.given ? "" : `${percent(light.coverage)} of all directions seen, ${percent(1 - light.knowledge.unseen_sky)} of the sky`);
  $("covered").style.width = `${100 * light.coverage}%`;
  const [low, high] = light.interval;
  const error = light.given ? `What the methods make of it is about ${percent(light.error)} off.` : `The light is about ${percent(light.captured)} off (${percent(low)} to ${percent(high)}).`;
  const way = light.given ? "" : light.guidance.replaceAll(" degrees", "°").replace(" and", ",").replace(/^turn/, "Look there: turn").replace(/^./, (c) => c.toUpperCase());
  const share = light.share >= 0.005 ? `That shows ${percent(light.share)} more of the sky's light. ` : "";
  say(way);
  setText($("guidance"), way), setText($("worth"), share + error);
  $("lights").replaceChildren(...light.lights.map(lightLine));
  drawLamps(light.lights);
}
function lightLine(lamp, k) {
  const item = make("li");
  item.append(make("b", `${k + 1}`), make("i", percent(lamp.share)), make("span",
    `${Math.round(lamp.elevation)}° up, ${(2 * lamp.radius).toFixed(0)}° wide` + (lamp.metres ? `, ${lamp.metres.toFixed(1)} m` : "")));
  item.title = "share of the light on a surface that faces it; how large it looks; where it is, if pictures from several places told it";
  return item;
}
function drawLamps(lights) {
  const canvas = $("lamps"), pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.font = "600 22px system-ui, sans-serif", pen.textAlign = "center", pen.textBaseline = "middle";
  lights.forEach((lamp, k) => {
    const x = (0.5 + lamp.azimuth / 360) * canvas.width, y = Math.max(16, (0.5 - lamp.elevation / 180) * canvas.height);
    pen.beginPath();
    pen.arc(x, y, 15, 0, 7);
    pen.fillStyle = "rgba(10,30,45,.72)";
    pen.fill();
    pen.fillStyle = "#fff";
    pen.fillText(`${k + 1}`, x, y + 1);
  });
}

// ---- The controls stand where the session is.

function put(id, value, name = id) {
  const element = $(id);
  if (!settled(name) || (document.activeElement === element && element.type === "number")) return;
  if (element.type === "checkbox") element.checked = value;
  else if (element.value !== String(value)) element.value = value;
}
function pressed(id, value, name = id) { if (settled(name)) $(id).setAttribute("aria-pressed", value); }
function renderControls(now, preparing) {
  put("object", now.object), put("material", now.material), put("turn", now.turn), put("shadow", now.shadow);
  setText($("turned"), `${Math.round(Number($("turn").value))}°`);
  put("error-budget", now.error ? Number((100 * now.error).toFixed(3)) : "", "error");
  put("time-budget", now.milliseconds || "", "milliseconds");
  put("methods", typeof now.methods === "string" ? now.methods : "own"), put("backend", now.backend);
  setText($("preparing"), preparing ? `preparing ${preparing} …` : "");
  pressed("freeze", now.freeze);
  pressed("record", Boolean(last.recording));
}
function methodOf(now, step) { return typeof now.methods === "string" ? (now.methods === "auto" ? "auto" : null) : now.methods[step] ?? "auto"; }

// ---- The plan.

const rows = new Map();
function rowOf(pass) {
  if (rows.has(pass.name)) return rows.get(pass.name);
  const row = make("tr"), cells = {};
  for (const [name, of] of [["name"], ["method"], ["error", "number"], ["expected", "number"], ["measured", "number measured"], ["bar"]])
    row.append((cells[name] = make("td", "", of)));
  cells.name.textContent = pass.name.replace("_", " ");
  cells.bar.append(make("span", "", "bar-measured"));
  if (pass.step) {
    const select = make("select");
    select.setAttribute("aria-label", `Method of ${pass.name}`);
    select.id = `method-${pass.step}`;
    select.append(make("option"), ...choices.methods[pass.step].filter((m) => m !== "auto").map((m) => Object.assign(make("option", m), { value: m })));
    select.options[0].value = "auto";
    select.addEventListener("change", () => {
      waiting[`method-${pass.step}`] = performance.now() + 1500;
      const now = last.settings.methods;
      const whole = now === "paper" ? choices.paper : {}; // what a change of one step goes on from
      change({ methods: { ...whole, [pass.step]: select.value } });
    });
    cells.method.append((cells.select = select));
  }
  rows.set(pass.name, { row, cells });
  $("plan").append(row);
  return rows.get(pass.name);
}
function renderPlan(s) {
  if (!s.plan || !choices) return;
  const plan = s.plan, worst = Math.max(1, ...plan.passes.map((p) => p.measured ?? 0));
  for (const pass of plan.passes) {
    const { row, cells } = rowOf(pass);
    row.hidden = !pass.included;
    if (cells.select) {
      setText(cells.select.options[0], methodOf(s.settings, pass.step) === null ? pass.method : `auto: ${pass.method}`);
      if (settled(`method-${pass.step}`) && document.activeElement !== cells.select) cells.select.value = methodOf(s.settings, pass.step) ?? "auto";
    } else setText(cells.method, pass.method || "–");
    setText(cells.error, pass.error === null ? "–" : percent(pass.error));
    setText(cells.expected, ms(pass.expected));
    setText(cells.measured, ms(pass.measured));
    row.classList.toggle("over", pass.expected > 0.5 && pass.measured > 2 * pass.expected);
    cells.bar.firstChild.style.width = `${(100 * (pass.measured ?? 0)) / worst}%`;
  }
  const out = plan.passes.filter((p) => !p.included);
  setText($("left-out"), out.length ? `Left out: ${out.map((p) => `${p.name.replace("_", " ")} (${p.reason})`).join("; ")}.` : "");
  setText($("plan-sum"), `${percent(plan.expected_error)} error and ${ms(plan.expected)} ms a frame are expected; ${ms(s.milliseconds.total)} ms measured`);
  const asked = s.settings.error || s.settings.milliseconds, kept = plan.meets_error && plan.meets_milliseconds;
  setText($("verdict"), !s.light ? "" : !asked ? "none" : kept ? "kept" :
    !plan.meets_error ? `not kept: the picture is within ${percent(plan.assured_error)}` : "not kept: frames take longer");
  $("verdict").className = !asked ? "" : kept ? "good" : "warn";
  if (s.state === "running") history.push(s.milliseconds.total ?? 0);
  while (history.length > 120) history.shift();
  spark();
}
function spark() {
  const canvas = $("spark"), pen = canvas.getContext("2d"), most = Math.max(5, ...history) * 1.1;
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.strokeStyle = getComputedStyle(document.body).getPropertyValue("--accent"), pen.lineWidth = 2.5;
  pen.beginPath();
  history.forEach((value, k) => pen.lineTo((k / 119) * canvas.width, canvas.height * (1 - value / most)));
  pen.stroke();
}
function showMessages(messages) {
  const lines = [...messages].reverse().map((m) => m.text);
  if (failure) lines.unshift(failure);
  const key = lines.join("\n");
  $("messages-card").hidden = !lines.length;
  if ($("messages").dataset.key === key) return;
  $("messages").dataset.key = key;
  $("messages").replaceChildren(...lines.map((line, k) => make("li", line, failure && !k ? "warn" : "")));
}

// ---- Begin.

function options(id, names) { $(id).replaceChildren(...names.map((name) => Object.assign(make("option", name), { value: name }))); }
function wire() {
  const press = (id, run) => $(id).addEventListener("click", run);
  const toggle = (name) => { const on = $(name).getAttribute("aria-pressed") !== "true"; $(name).setAttribute("aria-pressed", on); change({ [name]: on }); };
  press("freeze", () => toggle("freeze"));
  press("record", () => toggle("record"));
  press("step", () => change({ step: true }));
  press("restart", () => { history.length = 0; change({ restart: true }); });
  press("save", savePicture);
  press("axes", () => { axes = !axes; $("axes").setAttribute("aria-pressed", axes); shown = 0; aborting.abort(); });
  press("help", () => $("keys").showModal());
  for (const name of ["object", "material", "backend", "methods"]) $(name).addEventListener("change", () => change({ [name]: $(name).value }));
  // A list that was clicked gives the keys back; one that is chosen from by keys has them.
  let clicked = false;
  document.addEventListener("pointerdown", () => { clicked = true; }, true);
  document.addEventListener("keydown", () => { clicked = false; }, true);
  document.addEventListener("change", (event) => { if (clicked && event.target.matches("select")) event.target.blur(); });
  $("shadow").addEventListener("change", () => change({ shadow: $("shadow").checked }));
  let turning = 0;
  $("turn").addEventListener("input", () => {
    setText($("turned"), `${$("turn").value}°`), (waiting.turn = performance.now() + 1500);
    clearTimeout(turning), (turning = setTimeout(() => change({ turn: Number($("turn").value) }), 40));
  });
  const budget = (id, send) => $(id).addEventListener("change", () => {
    const field = $(id), value = Number(field.value);
    if (value >= Number(field.min) && value <= Number(field.max)) send(value);
    else note(`${field.labels[0].textContent} must be from ${field.min} to ${field.max}, got ${field.value}`);
  });
  budget("error-budget", (percents) => change({ error: percents / 100 }));
  budget("time-budget", (milliseconds) => change({ milliseconds }));
  const keys = { f: "freeze", " ": "freeze", s: "step", r: "record", p: "save", n: "restart", a: "axes", "?": "help", h: "help" };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || $("keys").open) return;
    if (event.target.matches("select, input[type=number]")) return; // they take letters and numbers themselves
    if (event.target.matches("input, button") && event.key === " ") return;
    const views = Object.keys(VIEWS);
    if (keys[event.key]) $(keys[event.key]).click(), event.preventDefault();
    else if (views[event.key - 1]) show(views[event.key - 1]);
  });
  addEventListener("pagehide", () => navigator.sendBeacon(address("leave")));
}
function views() {
  $("views").replaceChildren(...Object.entries(VIEWS).map(([name, label]) => {
    const button = make("button", label);
    button.setAttribute("role", "radio"), button.setAttribute("aria-checked", name === view);
    button.tabIndex = name === view ? 0 : -1;
    button.dataset.view = name;
    button.addEventListener("click", () => show(name));
    return button;
  }));
  // As radio buttons do: one stop of the tab key, arrows within.
  $("views").addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    const names = Object.keys(VIEWS), next = names[(names.indexOf(view) + step + names.length) % names.length];
    show(next), event.preventDefault();
    $("views").querySelector(`[data-view="${next}"]`).focus();
  });
}
function notices(lines) {
  $("notices").replaceChildren(...lines.map((line) => {
    const row = make("p"), text = make("span"), close = make("button", "×");
    fill(text, line);
    close.setAttribute("aria-label", "Hide this notice");
    close.addEventListener("click", () => row.remove());
    row.append(text, close);
    return row;
  }));
}
new ResizeObserver(() => document.body.style.setProperty("--notices", `${$("notices").offsetHeight}px`)).observe($("notices"));
async function begin() {
  while (!choices) {
    try { choices = await (await ask("choices")).json(); } catch { await sleep(1000); }
  }
  options("object", choices.objects), options("material", choices.materials), options("backend", choices.backends);
  $("backend").hidden = $("backend-label").hidden = choices.backends.length < 2;
  notices(choices.notices);
  views(), wire();
  pictures(), states(), small("map", $("map")), small("shadow", $("shadow-map"));
}
begin();
