// The map: which part of the floor is seen, and what is drawn on it.
const $ = (id) => document.getElementById(id);
const canvas = $("map"), pen = canvas.getContext("2d");
const TRAIL_S = 20, TRAIL_STEP_S = 0.5, JUMP = 1.5, FARTHEST = 1, CLOSEST = 40;
let floor = null, state = null, walls = null, wallsTint = null, looks = {}, chosen = null, asked = false;
let scale = 1, left = 0, top_ = 0, sight = { zoom: 1, x: 0, y: 0 };
const trails = new Map(), INKED = new Set(["link", "frozen", "off"]);

const colour = (id) => floor.colours[id];
const toScreen = (x, y) => [left + (x - floor.west) * scale, top_ + (floor.south + floor.height - y) * scale];
const toFloor = (px, py) => [floor.west + (px - left) / scale, floor.south + floor.height - (py - top_) / scale];
const robotOf = (id) => (state ? state.robots.find(([own]) => own === id) : undefined);
const goes = (word_) => word_ !== "off" && word_ !== "frozen";

function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; draw(); });
}
function loadFloor(told) {
  floor = told;
  looks = Object.fromEntries(floor.legend.map(([name, shape, tint]) => [name, { shape, tint }]));
  sight = { zoom: 1, x: floor.west + floor.width / 2, y: floor.south + floor.height / 2 };
  const image = new Image();
  image.onload = () => { walls = image; wallsTint = null; redraw(); };
  image.src = `data:image/png;base64,${floor.png}`;
}
function fit() {
  fitted(canvas);
  const { clientWidth: w, clientHeight: h } = canvas;
  scale = 0.96 * Math.min(w / floor.width, h / floor.height) * sight.zoom;
  left = w / 2 - (sight.x - floor.west) * scale;
  top_ = h / 2 - (floor.south + floor.height - sight.y) * scale;
}
function zoomBy(factor, px = canvas.clientWidth / 2, py = canvas.clientHeight / 2) {
  if (!floor) return;
  fit();
  const [x, y] = toFloor(px, py), zoom = Math.min(CLOSEST, Math.max(FARTHEST, sight.zoom * factor));
  const kept = sight.zoom / zoom; // the point under the pointer stays there
  look(x + (sight.x - x) * kept, y + (sight.y - y) * kept, zoom);
}
function panBy(dx, dy) {
  if (!floor) return;
  fit();
  look(sight.x - dx / scale, sight.y + dy / scale, sight.zoom);
}
function look(x, y, zoom) {
  const middle = [floor.west + floor.width / 2, floor.south + floor.height / 2];
  const free = 1 - 1 / zoom; // the whole floor stays in the middle
  const within = (value, centre, size) => Math.min(centre + (size * free) / 2, Math.max(centre - (size * free) / 2, value));
  sight = { zoom, x: within(x, middle[0], floor.width), y: within(y, middle[1], floor.height) };
  redraw();
}
function reveal(x, y) { // what keys move stays in sight
  fit();
  const [px, py] = toScreen(x, y), { clientWidth: w, clientHeight: h } = canvas;
  if (px < 20 || py < 20 || px > w - 20 || py > h - 20) look(x, y, sight.zoom);
}
function remember() { // trails grow by what comes; their beginning came with the page
  for (const [id, x, y] of state.robots) {
    const trail = trails.get(id) || [];
    if (!trail.length || state.t - trail[trail.length - 1][0] >= TRAIL_STEP_S) trail.push([state.t, x, y]);
    while (trail.length && state.t - trail[0][0] > TRAIL_S) trail.shift();
    trails.set(id, trail);
  }
}
function drawTrail(id, x, y) {
  let part = [];
  for (const [, tx, ty] of [...(trails.get(id) || []), [0, x, y]]) {
    const last = part[part.length - 1];
    if (last && Math.hypot(last[0] - tx, last[1] - ty) > JUMP) { // it was carried
      stretch(pen, "trail", colour(id), part.map((one) => toScreen(...one)));
      part = [];
    }
    part.push([tx, ty]);
  }
  stretch(pen, "trail", colour(id), part.map((one) => toScreen(...one)));
}
function drawRobot([id, x, y, heading, standing, , blocker]) {
  const [px, py] = toScreen(x, y), size = Math.max(4, floor.radii[id] * scale);
  pen.save();
  pen.globalAlpha = goes(standing) ? 1 : 0.45;
  pen.fillStyle = colour(id);
  disc(pen, px, py, size);
  pen.strokeStyle = "#fff";
  pen.lineWidth = 2;
  line(pen, [[px, py], [px + Math.cos(heading) * size, py - Math.sin(heading) * size]]);
  pen.restore();
  if (!goes(standing)) mark(pen, looks[standing].shape, css("--ink"), px, py, size);
  if (standing === "blocked") mark(pen, "blocked", looks.blocked.tint, px, py, size + 3);
  if (id === chosen) mark(pen, "ring", css("--ink"), px, py, size + 6);
  const words = { driving: "", blocked: ` blocked by ${blocker}` }[standing] ?? ` ${standing}`;
  if (state.robots.length <= 30 || id === chosen || sight.zoom > 2) word(pen, id + words, px + size + 4, py - size);
}
function drawPlaces() {
  const done = new Set(state.done), givenUp = new Set(state.given_up), before = floor.places.length;
  const size = Math.min(9, Math.max(4, 0.18 * scale));
  floor.places.concat(state.given).forEach(([owner, x, y], index) => {
    const name = done.has(index) ? "done" : givenUp.has(index) ? "given up" : index < before ? "open" : "given";
    mark(pen, looks[name].shape, colour(owner), ...toScreen(x, y), size);
  });
}
function drawThings() {
  const width = 0.1 * scale, stretched = ([x, y, toX, toY]) => [toScreen(x, y), toScreen(toX, toY)];
  floor.doors.forEach((one, index) => {
    const look_ = looks[state.closed.includes(index) ? "closed door" : "door"], points = stretched(one);
    stretch(pen, look_.shape, look_.tint, points, width * 2);
    if (state.closed.includes(index)) word(pen, "closed", points[1][0] + 6, points[1][1] - 6);
  });
  for (const [x, y, radius] of state.obstacles) mark(pen, "disc", looks.obstacle.tint, ...toScreen(x, y), radius * scale);
  for (const one of state.walls) stretch(pen, "bar", looks.wall.tint, stretched(one), width);
  for (const [x, y, radius, seconds] of state.jammers) {
    mark(pen, "dashed ring", looks.jammer.tint, ...toScreen(x, y), radius * scale);
    word(pen, `jammer, ${seconds.toFixed(0)} s left`, ...toScreen(x - radius, y + radius));
  }
}
function draw() {
  if (!floor || !state) return;
  fit();
  pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  const [x, y] = toScreen(floor.west, floor.south + floor.height), tint = css("--wall");
  if (walls) {
    if (!wallsTint || wallsTint.tint !== tint) wallsTint = { tint, image: tinted(walls, tint) };
    pen.imageSmoothingEnabled = false;
    pen.drawImage(wallsTint.image, x, y, floor.width * scale, floor.height * scale);
  }
  const at = state.robots.map(([, rx, ry]) => toScreen(rx, ry));
  for (const [one, other] of state.links) stretch(pen, "link", css("--ink"), [at[one], at[other]]);
  drawPlaces();
  drawThings();
  for (const [id, rx, ry, , , heads] of state.robots) {
    drawTrail(id, rx, ry);
    if (heads) stretch(pen, "dashes", colour(id), [toScreen(rx, ry), toScreen(...heads)]);
  }
  for (const [id, rx, ry, , , , blocker] of state.robots) {
    const other = blocker && robotOf(blocker);
    if (other) stretch(pen, "beam", looks.blocked.tint, [toScreen(rx, ry), toScreen(other[1], other[2])]);
  }
  state.robots.forEach(drawRobot);
  drawHand();
}
function drawLegend() {
  if (!floor) return;
  const list = $("legend");
  if (!list.children.length) {
    for (const [, , , says] of floor.legend) {
      const item = document.createElement("li"), picture = document.createElement("canvas");
      picture.setAttribute("aria-hidden", "true");
      item.append(picture, says);
      list.append(item);
    }
  }
  floor.legend.forEach(([name, shape, tint], index) => {
    const own = INKED.has(name) ? css("--ink") : Object.values(floor.colours)[0];
    sample(list.children[index].firstChild, shape, tint || own);
  });
}
