// Actions of buttons, pointers and keys: they send orders in the syntax of `acrc order RUN`.
const SURE_MS = 4000, MINE = 100, CLICK_PX = 4, MOVE_M = 0.1, FAR = 5, TURN = Math.PI / 12, SEND_MS = 100, PAUSE_MS = 1000;
const SPEEDS = [0.25, 0.5, 1, 2, 4, 10];
const brief = (...values) => values.map((one) => Math.round(one * 1000) / 1000).join(" ");
const all = (selector) => [...document.querySelectorAll(selector)], add = (parent, tag) => parent.appendChild(document.createElement(tag));
const pointers = new Map(), mine = new Set(); // unanswered orders of this page; its note shows no others
let tool = "move", drag = null, cursor = null, pinch = null, sure = 0;
let target = null; // pose of the selected robot after key presses, ahead of the state
const socket = new WebSocket(location.href.replace(/[?#].*/, "").replace(/^http/, "ws").replace(/\/?$/, "/socket"));
const HANDLERS = {
  floor: (message) => { loadFloor(message); nameItems(); },
  state: (message) => { state = message; remember(); show(); },
  order: showOrder,
};
socket.onmessage = ({ data }) => { const message = JSON.parse(data); HANDLERS[message.kind](message); redraw(); };
socket.onclose = ({ reason }) => {
  $("lost").textContent = state && state.over ? "The run has ended." : reason || "Connection to the run lost.";
  $("lost").hidden = false;
  if (!state) $("time").textContent = "not connected";
  for (const one of all("button, select, input")) one.disabled = !one.closest(".zoom");
};
function order(words) {
  if (socket.readyState !== WebSocket.OPEN) return;
  note("");
  mine.add(words);
  if (mine.size > MINE) mine.delete(mine.values().next().value);
  socket.send(words);
}
// --- text beside the map
const set = (id, words) => { if ($(id).textContent !== words) $(id).textContent = words; };
const note = (words) => set("note", words);
function showOrder({ number, order: words, times, waiting, refused, refusal }) {
  const list = $("orders");
  const item = list.querySelector(`[data-number="${number}"]`) || add(list, "li");
  if (!item.dataset.number) list.insertBefore(item, [...list.children].find((one) => Number(one.dataset.number) < number) || null);
  item.dataset.number = number;
  const share = times > 1 ? `${refused} of ${times} ` : "", result = waiting ? "pending" : "carried out";
  item.textContent = `${words}${times > 1 ? ` ×${times}` : ""}: ${refused ? `${share}refused: ${refusal}` : result}`;
  item.className = refused ? "no" : "";
  while (list.children.length > 100) list.lastChild.remove();
  if (!waiting && mine.delete(words) && refused) { note(`Refused: ${refusal}`); target = null; }
}
function show() {
  set("time", `${state.t.toFixed(1)} s${state.paused ? ", paused" : ""}${state.over ? ", ended" : ""}`);
  set("pause", state.paused ? "Resume" : "Pause");
  const speed = state.speed === 0 ? "max" : String(state.speed), choice = $("speed");
  if (![...choice.options].some((one) => one.value === speed)) choice.add(new Option(speed), 0);
  if (document.activeElement !== choice) choice.value = speed;
  const notes = [`${state.done} ${floor.items} ${floor.done}, ${state.left} left`];
  const problems = { "steps missed": state.missed, "updates skipped (slow page)": state.late, "invalid messages": state.junk };
  for (const [words, count_] of Object.entries(problems)) if (count_) notes.push(`${count_} ${words}`);
  set("count", notes.join("; "));
  showRobots();
}
function showRobots() {
  const list = $("robots"), one = robotOf(chosen), stands = one ? one[4] : "";
  for (const [id, , , , word_] of state.robots) {
    let button = list.querySelector(`[data-robot="${id}"]`);
    if (!button) {
      button = add(list, "button");
      [button.dataset.robot, button.onclick] = [id, () => chooseByName(id)];
      add(button, "i").style.background = colour(id);
      button.append(id);
      add(button, "b");
    }
    const chip = button.lastChild;
    if (chip.textContent !== word_) [chip.textContent, [chip.style.background, chip.style.color]] = [word_, floor.states[word_]];
    button.setAttribute("aria-pressed", String(id === chosen));
  }
  set("chosen", one ? `Robot ${chosen}` : "No robot selected");
  const by = one && one[6] ? ` by ${one[6]}` : "", heads = one && one[5] ? `, next ${floor.item} at ${one[5].map((v) => v.toFixed(1)).join(", ")}` : "";
  set("about", one ? `${stands}${by}${heads}` : "Select a robot on the map, in the list, or with n.");
  const can = { freeze: goes(stands), thaw: stands === "frozen", kill: stands !== "off", restart: stands === "off" };
  for (const button of all("[data-order]")) button.disabled = !one || !can[button.dataset.order];
}
function choose(id) {
  if (id !== chosen) [chosen, target] = [id, null];
  if (state) showRobots();
  redraw();
}
const chooseByName = (id) => { if (tool !== "give") useTool("move"); choose(id); note(`${id} selected.`); }; // so that arrow keys move it
function toRobot(verb) {
  const one = robotOf(chosen);
  if (!one) note("Select a robot first.");
  else if (document.querySelector(`[data-order="${verb}"]`).disabled) note(`Cannot ${verb} ${chosen}: it is ${one[4]}.`);
  else order(`${verb} ${chosen}`);
}
function askStop(again = true) { // stops the run at the second press
  const button = $("stop"), stops = again && sure;
  clearTimeout(sure);
  sure = again && !stops ? setTimeout(askStop, SURE_MS, false) : 0;
  button.classList.toggle("sure", Boolean(sure));
  button.textContent = sure ? "Stop: confirm" : "Stop";
  if (sure) note("Press Stop again to end the run.");
  if (stops) order("stop");
}
// --- tools; `begun`: hint after a click without dragging
const TOOLS = {
  move: { key: "m", words: "Arrow keys move the selected robot." },
  wall: { key: "w", words: "Wall: arrow keys move the cursor, Enter sets each end.", begun: "Drag from one end to the other to add a wall.", order: (d) => `wall ${brief(d.fromX, d.fromY, d.x, d.y)}` },
  obstacle: { key: "o", words: "Obstacle: Enter at its centre, then at its edge.", begun: "Drag from the centre outward to add an obstacle.", order: (d, far) => `obstacle ${brief(d.fromX, d.fromY, far)}` },
  give: { key: "g", words: "Item: Enter adds it for the selected robot." },
  door: { key: "d", words: "Door: Enter closes or opens the door at the cursor." },
  jam: { key: "j", words: "Jammer: Enter at its centre, then at its edge.", begun: "Drag from the centre outward to add a jammer.", order: (d, far) => `jam ${brief(d.fromX, d.fromY, far)} ${$("seconds").value}` },
};
function nameItems() { // as the task calls them; only points are given by a click
  const button = document.querySelector("[data-tool=give]"), word_ = floor.item.charAt(0).toUpperCase() + floor.item.slice(1);
  button.textContent = word_;
  button.title = floor.is_point ? `Click to add a ${floor.item} for the selected robot` : `Give the ${floor.item} beside to the selected robot`;
  $("item").hidden = floor.is_point;
  $("item").onkeydown = ({ key }) => { if (key === "Enter") give(); };
}
function give(...point) {
  let item = floor.is_point ? brief(...point) : $("item").value;
  if (!chosen) note(`Select the robot of the ${floor.item} first.`);
  else {
    try { if (!floor.is_point) item = JSON.stringify(JSON.parse(item)); } catch { note(`Enter the ${floor.item} as JSON text beside its button.`); return; }
    order(`give ${chosen} ${item}`);
  }
}
function useTool(name) {
  if (name === "give" && !floor.is_point) { give(); return; }
  [tool, drag] = [name, null];
  for (const one of all("[data-tool]")) one.setAttribute("aria-pressed", String(one.dataset.tool === name));
  redraw();
}
function under(x, y) {
  return state.robots.filter(([id, rx, ry]) => Math.hypot(rx - x, ry - y) <= Math.max(floor.robots[id].radius, 12 / scale)).at(-1);
}
function away([[ax, ay], [bx, by]], x, y) { // distance from a segment, m
  const [dx, dy] = [bx - ax, by - ay], along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), t = Math.min(1, Math.max(0, along));
  return Math.hypot(ax + t * dx - x, ay + t * dy - y);
}
function act(x, y) { // tools with one point
  if (tool === "give") { give(x, y); return; }
  const door = [...floor.doors].sort((one, other) => away(one, x, y) - away(other, x, y))[0];
  if (!door || away(door, x, y) > DOOR_M) note(door ? `No door within ${DOOR_M} m.` : "This floor has no door.");
  else order(`${isShut(door) ? "open" : "close"} ${brief(...middleOf(door))}`);
}
function put(done) { // tools with two points
  if (tool === "jam" && !(Number($("seconds").value) > 0)) note("Enter a jammer duration above 0 s.");
  else order(TOOLS[tool].order(done, Math.hypot(done.x - done.fromX, done.y - done.fromY)));
}
function drawHand() { // drawing in progress, and the keyboard cursor
  if (drag && (tool !== "move" || drag.robot)) {
    const from = toScreen(drag.fromX, drag.fromY), to = toScreen(drag.x, drag.y), far = Math.hypot(from[0] - to[0], from[1] - to[1]);
    if (tool === "wall") mark(pen, "bar", floor.legend.wall[1], [from, to], 0.1 * scale);
    if (tool === "obstacle") mark(pen, "ring", floor.legend.obstacle[1], [from], far);
    if (tool === "jam") mark(pen, "dashed ring", floor.legend.jammer[1], [from], far);
    if (tool === "move") mark(pen, "ring", css("--accent"), [to], floor.robots[drag.robot[0]].radius * scale);
  }
  if (cursor && document.activeElement === canvas) mark(pen, "cross", css("--accent"), [toScreen(...cursor)], 12);
}
// --- pointers: one for tools; two, the middle button or the wheel for the view
const middle = ([a, b] = [...pointers.values()]) => ({ x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, far: Math.hypot(a.x - b.x, a.y - b.y) });
canvas.onpointerdown = (event) => {
  if (!floor || !state) return;
  event.preventDefault(); // a middle button would scroll
  canvas.focus({ preventScroll: true });
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, pans: event.button === 1 });
  cursor = null;
  if (pointers.size === 2) { drag = null; pinch = middle(); redraw(); }
  if (pointers.size > 1 || event.button !== 0) return;
  const [x, y] = toFloor(event.offsetX, event.offsetY), robot = under(x, y);
  if (tool === "move" && robot) choose(robot[0]);
  drag = { fromX: x, fromY: y, x, y, px: event.offsetX, py: event.offsetY, robot };
};
canvas.onpointermove = (event) => {
  const own = pointers.get(event.pointerId);
  if (!own) return;
  const [dx, dy] = [event.offsetX - own.x, event.offsetY - own.y];
  Object.assign(own, { x: event.offsetX, y: event.offsetY });
  if (pinch && pointers.size === 2) {
    const now = middle();
    panBy(now.x - pinch.x, now.y - pinch.y);
    if (pinch.far > 0) zoomBy(now.far / pinch.far, now.x, now.y);
    pinch = now;
  } else if (own.pans) panBy(dx, dy);
  else if (drag) { [drag.x, drag.y] = toFloor(event.offsetX, event.offsetY); redraw(); }
};
canvas.onpointerup = canvas.onpointercancel = (event) => {
  const done = drag, clicked = done && Math.hypot(event.offsetX - done.px, event.offsetY - done.py) < CLICK_PX;
  pointers.delete(event.pointerId);
  if (!pointers.size) pinch = null;
  redraw();
  if (!done || event.button > 0) return;
  drag = null;
  if (event.type === "pointercancel") return;
  if (tool === "give" || tool === "door") act(done.x, done.y);
  else if (tool === "move" && !done.robot) { choose(null); note("No robot there. Click a robot to select it, or drag it to move it."); }
  else if (clicked) note(TOOLS[tool].begun || "");
  else if (tool === "move") order(`move ${done.robot[0]} ${brief(done.x, done.y, done.robot[3])}`);
  else put(done);
};
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoomBy(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY); }, { passive: false });
canvas.onfocus = canvas.onblur = redraw;
// --- keys, except in input fields; on a button, Space and Enter press it
function steer(dx, dy, turn = 0) {
  const one = robotOf(chosen), now = performance.now();
  if (!one) { note("Select a robot first."); return; }
  if (!target || now - target.pressed > PAUSE_MS) target = { x: one[1], y: one[2], heading: one[3], sent: 0, timer: 0 };
  Object.assign(target, { x: target.x + dx, y: target.y + dy, heading: target.heading + turn, pressed: now });
  reveal(target.x, target.y);
  if (!target.timer) target.timer = setTimeout(send, Math.max(0, SEND_MS - (now - target.sent)), target, chosen);
}
function send(to, id) { // a key that is held down repeats faster than a run takes orders
  [to.timer, to.sent] = [0, performance.now()];
  if (to === target) order(`move ${id} ${brief(to.x, to.y, Math.atan2(Math.sin(to.heading), Math.cos(to.heading)))}`);
}
function moveCursor(dx, dy) {
  const [x, y] = cursor || [sight.x, sight.y];
  cursor = [x + dx, y + dy];
  if (drag) [drag.x, drag.y] = cursor;
  reveal(...cursor);
  canvas.focus({ preventScroll: true });
  redraw();
}
function arrow(dx, dy, far) {
  const step = MOVE_M * (far ? FAR : 1), moves = chosen !== null && tool === "move";
  if (moves) steer(dx * step, dy * step); else moveCursor(dx * step * 2, dy * step * 2);
}
function enter() {
  if (!cursor) moveCursor(0, 0);
  const [x, y] = cursor, robot = under(x, y);
  if (tool === "give" || tool === "door") act(x, y);
  else if (tool === "move" && robot) chooseByName(robot[0]);
  else if (tool === "move") note("No robot under the cursor.");
  else if (!drag) { drag = { fromX: x, fromY: y, x, y }; note("Started. Arrow keys move the end, Enter finishes, Escape cancels."); }
  else if (drag.fromX === x && drag.fromY === y) note("Move the cursor first: the length is 0.");
  else { put(drag); drag = null; }
  redraw();
}
function escape() {
  askStop(false);
  if (drag) { drag = null; note("Cancelled."); redraw(); } else choose(null);
}
function nextRobot(by) {
  const ids = state.robots.map(([id]) => id), at = ids.indexOf(chosen);
  chooseByName(ids[at < 0 ? (by > 0 ? 0 : ids.length - 1) : (at + by + ids.length) % ids.length]);
}
function faster(by) {
  const now = state.speed === 0 ? Infinity : state.speed;
  const next = by > 0 ? SPEEDS.find((one) => one > now) : SPEEDS.findLast((one) => one < now);
  if (next || by > 0) order(`speed ${next || "max"}`); else note("This is the lowest speed.");
}
const pause = () => order(state && state.paused ? "resume" : "pause"), whole = () => floor && look(0, 0, 1), closer = () => zoomBy(1.5), farther = () => zoomBy(1 / 1.5);
const KEYS = [
  ["n p", "select the next or previous robot", { n: () => nextRobot(1), p: () => nextRobot(-1) }],
  ["arrows", "move the selected robot 0.1 m (Shift: 0.5 m), or without one the cursor 0.2 m (1 m)", { ArrowLeft: (far) => arrow(-1, 0, far), ArrowRight: (far) => arrow(1, 0, far), ArrowUp: (far) => arrow(0, 1, far), ArrowDown: (far) => arrow(0, -1, far) }],
  ["q e", "turn the selected robot left, right", { q: () => steer(0, 0, TURN), e: () => steer(0, 0, -TURN) }],
  ["f t k r", "freeze, thaw, kill, restart the selected robot", Object.fromEntries(["freeze", "thaw", "kill", "restart"].map((verb) => [verb[0], () => toRobot(verb)]))],
  ["Space", "pause, resume; on a button, press it", { " ": pause }],
  [".", "execute one step, then pause", { ".": () => order("step") }],
  ["[ ]", "slower, faster", { "[": () => faster(-1), "]": () => faster(1) }],
  ["x x", "stop the run (press twice)", { x: () => askStop() }],
  ["m w o g d j", "tools: move, wall, obstacle, item, door, jammer", Object.fromEntries(Object.entries(TOOLS).map(([name, { key, words }]) => [key, () => { useTool(name); if (tool === name) note(words); }]))],
  ["Enter", "apply the tool at the cursor, or select the robot there", { Enter: enter }],
  ["Escape", "cancel, or deselect the robot", { Escape: escape }],
  ["+ − 0", "zoom in, out, the whole floor", { "+": closer, "=": closer, "-": farther, 0: whole }],
];
const BY_KEY = new Map(KEYS.flatMap(([, , does]) => Object.entries(does)));
for (const [keys, does] of KEYS) [keys, does].forEach((words, index) => { add($("keys"), index ? "dd" : "dt").textContent = words; });
addEventListener("keydown", (event) => {
  if (!state || !$("lost").hidden || event.ctrlKey || event.altKey || event.metaKey) return;
  const on = event.target.closest ? event.target.closest("input, select, button, summary") : null;
  if (on && (["INPUT", "SELECT"].includes(on.tagName) || [" ", "Enter"].includes(event.key))) return; // after pointer use focus is on the map
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, does = BY_KEY.get(key);
  if (!does) return;
  event.preventDefault();
  if (!event.repeat || key.startsWith("Arrow") || "+=-qe".includes(key)) does(event.shiftKey);
});
for (const button of all("[data-order]")) [button.disabled, button.onclick] = [true, () => toRobot(button.dataset.order)];
for (const button of all("[data-tool]")) button.onclick = () => useTool(button.dataset.tool);
for (const [id, does] of Object.entries({ pause, step: () => order("step"), stop: () => askStop(), closer, farther, whole })) $(id).onclick = does;
$("speed").onchange = (event) => { order(`speed ${event.target.value}`); canvas.focus({ preventScroll: true }); };
document.addEventListener("click", ({ detail, target: on }) => detail && on.closest("button, summary") && canvas.focus({ preventScroll: true })); // detail is 0 for keys
for (const one of all("details")) one.ontoggle = drawLegend;
matchMedia("(prefers-color-scheme: dark)").onchange = () => { drawLegend(); redraw(); };
addEventListener("resize", redraw);
