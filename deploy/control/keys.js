// What keys do, wherever focus is but in a field; keys that a button needs do the button's own thing.
const MOVE_M = 0.1, FAR = 5, TURN = Math.PI / 12, SEND_MS = 100, PAUSE_MS = 1000;
const SPEEDS = [0.25, 0.5, 1, 2, 4, 10];
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
let target = null; // where keys have brought the chosen robot: the state lags behind them

function forgetTarget() {
  target = null;
}
function steer(dx, dy, turn) {
  const one = robotOf(chosen), now = performance.now();
  if (!target || now - target.pressed > PAUSE_MS) target = { x: one[1], y: one[2], heading: one[3], series: newSeries(), sent: 0, timer: 0 };
  target.x += dx;
  target.y += dy;
  target.heading += turn;
  target.pressed = now;
  reveal(target.x, target.y);
  if (!target.timer) target.timer = setTimeout(send, Math.max(0, SEND_MS - (now - target.sent)), target, chosen);
}
function send(to, id) { // a key that is held down repeats faster than a run takes orders
  to.timer = 0;
  to.sent = performance.now();
  if (to === target) order(`move ${id} ${brief(to.x)} ${brief(to.y)} ${brief(Math.atan2(Math.sin(to.heading), Math.cos(to.heading)))}`, to.series);
}
function moveCursor(dx, dy) {
  const at = cursor || [sight.x, sight.y];
  cursor = [at[0] + dx, at[1] + dy];
  if (drag) [drag.x, drag.y] = cursor;
  reveal(...cursor);
  canvas.focus({ preventScroll: true });
  redraw();
}
function arrow([dx, dy], far) {
  const step = MOVE_M * (far ? FAR : 1);
  if (chosen !== null && tool === "move") steer(dx * step, dy * step, 0);
  else moveCursor(dx * step * 2, dy * step * 2);
}
function turn(by) {
  if (chosen === null) note("Choose a robot first.");
  else steer(0, 0, by);
}
function enter() {
  if (!cursor) moveCursor(0, 0);
  const [x, y] = cursor;
  if (tool === "give" || tool === "door") act(x, y);
  else if (tool === "move") {
    const there = under(x, y);
    if (there) chooseByName(there[0]);
    else note("No robot under the cursor.");
  } else if (!drag) {
    drag = { fromX: x, fromY: y, x, y, robot: null };
    note("Begun. Arrow keys go on, Enter ends, Escape drops it.");
  } else if (drag.fromX === x && drag.fromY === y) note("Move the cursor first: it is where it began.");
  else {
    const done = drag;
    drag = null;
    put(done);
  }
  redraw();
}
function escape() {
  calm();
  if (drag) { drag = null; note("Dropped."); redraw(); } else choose(null);
}
function nextRobot(by) {
  const ids = state.robots.map(([id]) => id), at = ids.indexOf(chosen);
  chooseByName(ids[at < 0 ? (by > 0 ? 0 : ids.length - 1) : (at + by + ids.length) % ids.length]);
}
function faster(by) {
  const now = state.speed === 0 ? Infinity : state.speed;
  const next = by > 0 ? SPEEDS.find((one) => one > now) : SPEEDS.findLast((one) => one < now);
  if (next || by > 0) order(`speed ${next || "max"}`);
  else note("Slower is not offered here.");
}
function useKey(name, words) {
  useTool(name);
  note(words);
}
const KEYS = [
  ["n p", "choose the next, the previous robot", { n: () => nextRobot(1), p: () => nextRobot(-1) }],
  ["arrows", "move the chosen robot 0.1 m, with Shift 0.5 m; else the cursor, 0.2 m or 1 m", {}],
  ["q e", "turn the chosen robot left, right", { q: () => turn(TURN), e: () => turn(-TURN) }],
  ["f t k r", "freeze, thaw, kill, restart it", { f: () => toRobot("freeze"), t: () => toRobot("thaw"), k: () => toRobot("kill"), r: () => toRobot("restart") }],
  ["Space", "pause, resume; on a button: press it", { " ": () => pause() }],
  [".", "one step, then pause", { ".": () => order("step") }],
  ["[ ]", "slower, faster", { "[": () => faster(-1), "]": () => faster(1) }],
  ["x x", "stop the run: asked twice", { x: askStop }],
  ["m w o g d j", "move robots; put a wall, an obstacle; give a place; doors; put a jammer", {
    m: () => useKey("move", "Arrow keys move the chosen robot."),
    w: () => useKey("wall", "Wall: arrow keys move the cursor, Enter begins and ends."),
    o: () => useKey("obstacle", "Obstacle: Enter in its middle, then at its rim."),
    g: () => useKey("give", "Place: Enter gives it to the chosen robot."),
    d: () => useKey("door", "Door: Enter closes or opens the door at the cursor."),
    j: () => useKey("jam", "Jammer: Enter in its middle, then at its rim.") }],
  ["Enter", "do it at the cursor; choose the robot there", { Enter: enter }],
  ["Escape", "drop what is begun; choose no robot", { Escape: escape }],
  ["+ − 0", "zoom in, out, the whole floor", { "+": () => zoomBy(1.5), "=": () => zoomBy(1.5), "-": () => zoomBy(1 / 1.5), 0: () => look(0, 0, 1) }],
];
const BY_KEY = new Map(KEYS.flatMap(([, , does]) => Object.entries(does)));
for (const [keys, does] of KEYS) {
  const [name, words] = [document.createElement("dt"), document.createElement("dd")];
  [name.textContent, words.textContent] = [keys, does];
  $("keys").append(name, words);
}
addEventListener("keydown", (event) => {
  if (!state || !$("lost").hidden || event.ctrlKey || event.altKey || event.metaKey) return;
  const on = event.target.closest ? event.target.closest("input, select, button, summary") : null;
  if (on && ["INPUT", "SELECT"].includes(on.tagName)) return;
  if (on && [" ", "Enter"].includes(event.key)) return; // reached by keyboard: a pointer leaves focus on the map
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, does = BY_KEY.get(key);
  if (!does && !ARROWS[key]) return;
  event.preventDefault();
  if (event.repeat && !ARROWS[key] && !"+=-qe".includes(key)) return;
  if (ARROWS[key]) arrow(ARROWS[key], event.shiftKey);
  else does();
});
