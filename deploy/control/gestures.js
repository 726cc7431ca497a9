// What a pointer does on the map: tools with one, the view with two, with the middle button, with the wheel.
const CLICK_PX = 4, DOOR_M = 1;
const FROM_TO = { // tools that are drawn from one point to another
  wall: (from, to) => `wall ${from} ${to}`,
  obstacle: (from, to, far) => `obstacle ${from} ${far}`,
  jam: (from, to, far) => `jam ${from} ${far} ${$("seconds").value}`,
};
const WHY_NOT = {
  move: "No robot there. Choose one, or drag one to move it.",
  wall: "Drag from one end to the other to draw a wall.",
  obstacle: "Drag from the middle to the rim to put an obstacle.",
  jam: "Drag from the middle to the rim to put a jammer.",
};
const pointers = new Map();
let tool = "move", drag = null, cursor = null, pinch = null;

function useTool(name) {
  tool = name;
  drag = null;
  for (const one of document.querySelectorAll("[data-tool]")) one.setAttribute("aria-pressed", String(one.dataset.tool === name));
  redraw();
}
for (const button of document.querySelectorAll("[data-tool]")) button.onclick = () => useTool(button.dataset.tool);

function under(x, y) {
  const near = state.robots.filter(([id, rx, ry]) => Math.hypot(rx - x, ry - y) <= Math.max(floor.radii[id], 12 / scale));
  return near.length ? near[near.length - 1] : null;
}
function doorAt(x, y) { // its index, or -1
  let nearest = DOOR_M, found = -1;
  floor.doors.forEach(([ax, ay, bx, by], index) => {
    const [dx, dy] = [bx - ax, by - ay], long = dx * dx + dy * dy;
    const along = long ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / long)) : 0;
    const far = Math.hypot(ax + along * dx - x, ay + along * dy - y);
    if (far <= nearest) [nearest, found] = [far, index];
  });
  return found;
}
function act(x, y) { // a click of the tools that need one point
  if (tool === "give" && !chosen) note("Choose a robot first: the place is given to it.");
  else if (tool === "give") order(`give ${chosen} ${brief(x)} ${brief(y)}`);
  if (tool !== "door") return;
  const index = doorAt(x, y);
  if (index < 0) { note(floor.doors.length ? `No door within ${DOOR_M} m.` : "This floor has no door."); return; }
  const [ax, ay, bx, by] = floor.doors[index];
  order(`${state.closed.includes(index) ? "open" : "close"} ${brief((ax + bx) / 2)} ${brief((ay + by) / 2)}`);
}
function put({ fromX, fromY, x, y }) {
  const far = Math.hypot(x - fromX, y - fromY);
  if (tool === "jam" && !(Number($("seconds").value) > 0)) note("A jammer needs a number of seconds above 0.");
  else order(FROM_TO[tool]([fromX, fromY].map(brief).join(" "), [x, y].map(brief).join(" "), brief(far)));
}
function drawHand() { // what is being drawn, and the cursor of the keys
  if (drag) {
    const far = Math.hypot(drag.x - drag.fromX, drag.y - drag.fromY) * scale, from = toScreen(drag.fromX, drag.fromY);
    if (tool === "wall") stretch(pen, "bar", looks.wall.tint, [from, toScreen(drag.x, drag.y)], 0.1 * scale);
    if (tool === "obstacle") mark(pen, "ring", looks.obstacle.tint, ...from, far);
    if (tool === "jam") mark(pen, "dashed ring", looks.jammer.tint, ...from, far);
    if (tool === "move" && drag.robot) mark(pen, "ring", css("--accent"), ...toScreen(drag.x, drag.y), floor.radii[drag.robot[0]] * scale);
  }
  if (!cursor || document.activeElement !== canvas) return;
  const [px, py] = toScreen(...cursor);
  pen.save();
  pen.strokeStyle = css("--accent");
  pen.lineWidth = 2;
  line(pen, [[px - 12, py], [px + 12, py]]);
  line(pen, [[px, py - 12], [px, py + 12]]);
  pen.restore();
}
const middle = () => {
  const [a, b] = [...pointers.values()];
  return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, far: Math.hypot(a.x - b.x, a.y - b.y) };
};
canvas.onpointerdown = (event) => {
  if (!floor || !state) return;
  event.preventDefault(); // a middle button would scroll
  canvas.focus({ preventScroll: true });
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, pans: event.button === 1 });
  cursor = null;
  if (pointers.size === 2) { drag = null; pinch = middle(); redraw(); }
  if (pointers.size > 1 || event.button !== 0) return;
  const [x, y] = toFloor(event.offsetX, event.offsetY), there = under(x, y);
  if (tool === "move" && there) choose(there[0]);
  drag = { fromX: x, fromY: y, x, y, px: event.offsetX, py: event.offsetY, robot: there };
};
canvas.onpointermove = (event) => {
  const own = pointers.get(event.pointerId);
  if (!own) return;
  const [dx, dy] = [event.offsetX - own.x, event.offsetY - own.y];
  [own.x, own.y] = [event.offsetX, event.offsetY];
  if (pinch && pointers.size === 2) {
    const now = middle();
    panBy(now.x - pinch.x, now.y - pinch.y);
    if (pinch.far > 0) zoomBy(now.far / pinch.far, now.x, now.y);
    pinch = now;
  } else if (own.pans) panBy(dx, dy);
  else if (drag) {
    [drag.x, drag.y] = toFloor(event.offsetX, event.offsetY);
    redraw();
  }
};
function let_go(event) {
  pointers.delete(event.pointerId);
  if (!pointers.size) pinch = null;
  redraw();
}
canvas.onpointercancel = (event) => { drag = null; let_go(event); };
canvas.onpointerup = (event) => {
  let_go(event);
  if (!drag || event.button !== 0) return;
  const done = drag, clicked = Math.hypot(event.offsetX - done.px, event.offsetY - done.py) < CLICK_PX;
  drag = null;
  if (tool === "give" || tool === "door") act(done.x, done.y);
  else if (tool === "move" && !done.robot) { choose(null); note(WHY_NOT.move); }
  else if (clicked) note(tool === "move" ? "" : WHY_NOT[tool]);
  else if (tool === "move") order(`move ${done.robot[0]} ${brief(done.x)} ${brief(done.y)} ${brief(done.robot[3])}`, newSeries());
  else put(done);
};
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomBy(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
}, { passive: false });
canvas.onfocus = canvas.onblur = redraw;
