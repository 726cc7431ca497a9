// What the run says, in words beside the map, and the orders that buttons give.
const SURE_MS = 4000, MINE = 100;
const brief = (value) => String(Math.round(value * 1000) / 1000);
const mine = new Set(); // orders of this page that nobody has answered: others' are no news for its note
let series = 0;

const socket = new WebSocket(location.href.replace(/[?#].*/, "").replace(/^http/, "ws").replace(/\/?$/, "/socket"));
socket.onmessage = (event) => {
  const told = JSON.parse(event.data);
  if (told.kind === "floor") loadFloor(told);
  if (told.kind === "past") for (const [id, trail] of Object.entries(told.trails)) trails.set(id, trail);
  if (told.kind === "state") { state = told; remember(); show(); }
  if (told.kind === "said") said(told);
  redraw();
};
socket.onclose = (event) => {
  const over = state && state.over;
  $("lost").textContent = over ? "The run is over." : event.reason || "The connection to the run has ended.";
  $("lost").hidden = false;
  if (!state) $("time").textContent = "not connected";
  for (const one of document.querySelectorAll("button, select, input")) one.disabled = !one.closest(".zoom");
};

function note(words) {
  $("note").textContent = words;
}
function order(words, of = 0) {
  if (socket.readyState !== WebSocket.OPEN) return;
  note("");
  mine.add(words);
  if (mine.size > MINE) mine.delete(mine.values().next().value);
  socket.send(JSON.stringify({ series: of, order: words }));
}
function newSeries() { // of two pages no two are the same, but for great chance
  series = 1 + Math.floor(Math.random() * 0x7ffffffe);
  return series;
}
function said(told) {
  let item = $("said").querySelector(`[data-number="${told.number}"]`);
  if (!item) {
    item = document.createElement("li");
    item.dataset.number = told.number;
    const after = [...$("said").children].find((one) => Number(one.dataset.number) < told.number);
    $("said").insertBefore(item, after || null);
  }
  const times = told.times > 1 ? ` ×${told.times}` : "", share = told.times > 1 ? `${told.refused} of ${told.times} ` : "";
  const become = told.refused ? `${share}not done: ${told.refusal}` : told.waiting ? "waits" : "carried out";
  item.textContent = `${told.order}${times}: ${become}`;
  item.className = told.refused ? "no" : "";
  while ($("said").children.length > 100) $("said").lastChild.remove();
  if (!told.waiting && mine.delete(told.order) && told.refused) {
    note(`Not done: ${told.refusal}`);
    forgetTarget();
  }
}
function showSpeed(speed) {
  const choice = $("speed");
  if (document.activeElement === choice) return;
  if (![...choice.options].some((one) => one.value === speed)) choice.add(new Option(speed), 0);
  choice.value = speed;
}
function set(element, words) {
  if (element.textContent !== words) element.textContent = words;
}
function show() {
  const all = floor.places.length + state.given.length, left_ = all - state.done.length - state.given_up.length;
  set($("time"), `${state.t.toFixed(1)} s${state.paused ? ", paused" : ""}${state.over ? ", over" : ""}`);
  set($("pause"), state.paused ? "Resume" : "Pause");
  showSpeed(state.speed === 0 ? "max" : String(state.speed));
  const notes = [`${state.done.length} of ${all} places done, ${left_} left`];
  if (state.missed) notes.push(`${state.missed} steps did not come here`);
  if (state.late) notes.push(`${state.late} pictures left out: this page is slow`);
  if (state.junk) notes.push(`${state.junk} messages were no orders`);
  set($("count"), notes.join("; "));
  showRobots();
  showChosen();
}
function showRobots() {
  const list = $("robots");
  state.robots.forEach(([id, , , , word_], index) => {
    let button = list.children[index];
    if (!button) {
      button = document.createElement("button");
      button.dataset.robot = id;
      button.append(document.createElement("i"), id, document.createElement("b"));
      button.firstChild.style.background = colour(id);
      button.onclick = () => chooseByName(id);
      list.append(button);
    }
    const chip = button.lastChild;
    if (chip.textContent !== word_) {
      chip.textContent = word_;
      [chip.style.background, chip.style.color] = floor.states[word_];
    }
    button.setAttribute("aria-pressed", String(id === chosen));
  });
}
function showChosen() {
  const one = robotOf(chosen), word_ = one ? one[4] : "";
  set($("chosen"), one ? `Robot ${chosen}` : "No robot chosen");
  const by = one && one[6] ? ` by ${one[6]}` : "", heads = one && one[5] ? `, next place at ${one[5].map((v) => v.toFixed(1)).join(", ")}` : "";
  set($("about"), one ? `${word_}${by}${heads}` : "Choose a robot on the map, below, or with n.");
  const can = { freeze: goes(word_), thaw: word_ === "frozen", kill: word_ !== "off", restart: word_ === "off" };
  for (const button of document.querySelectorAll("[data-order]")) button.disabled = !one || !can[button.dataset.order];
}
function choose(id) {
  if (id !== chosen) forgetTarget();
  chosen = id;
  if (state) { showRobots(); showChosen(); }
  redraw();
}
function chooseByName(id) { // so arrow keys move it
  if (tool !== "give") useTool("move");
  choose(id);
  note(`${id} is chosen.`);
}
function toRobot(verb) {
  const button = document.querySelector(`[data-order="${verb}"]`), one = robotOf(chosen);
  if (!one) note("Choose a robot first.");
  else if (button.disabled) note(`Cannot ${verb} ${chosen}: it is ${one[4]}.`);
  else order(`${verb} ${chosen}`);
}
function askStop() {
  const button = $("stop");
  if (button.classList.contains("sure")) {
    order("stop");
    calm();
    return;
  }
  button.classList.add("sure");
  button.textContent = "Stop: sure?";
  note("Stop ends the run for good. Ask once more to do so.");
  askStop.timer = setTimeout(calm, SURE_MS);
}
function calm() {
  clearTimeout(askStop.timer);
  $("stop").classList.remove("sure");
  $("stop").textContent = "Stop";
}
for (const button of document.querySelectorAll("[data-order]")) {
  button.disabled = true;
  button.onclick = () => toRobot(button.dataset.order);
}
const pause = () => order(state && state.paused ? "resume" : "pause");
$("pause").onclick = pause;
$("step").onclick = () => order("step");
$("stop").onclick = askStop;
$("speed").onchange = (event) => { order(`speed ${event.target.value}`); canvas.focus({ preventScroll: true }); };
$("closer").onclick = () => zoomBy(1.5);
$("farther").onclick = () => zoomBy(1 / 1.5);
$("whole").onclick = () => floor && look(0, 0, 1);
document.addEventListener("click", (event) => { // detail 0: by a key, so focus stays where one works
  if (event.detail && event.target.closest("button, summary")) canvas.focus({ preventScroll: true });
});
for (const one of document.querySelectorAll("details")) one.ontoggle = drawLegend;
addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").onchange = () => { drawLegend(); redraw(); };
