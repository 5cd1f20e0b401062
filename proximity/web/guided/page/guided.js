// Shows the steps of a program, and sends it a person's answers; a watching page only shows, and stops.

const AGAIN_MS = 600;
const FINAL = {
  1000: "",
  4403: "This address lacks its token: open the address that was printed.",
  4409: "The page was opened elsewhere, and goes on there.",
  4429: "There are too many pages already.",
};
const KEYS = { " ": "Space", ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" };
const byId = (id) => document.getElementById(id);
const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";

let socket, about = {}, step = {}, shownMs = 0, isAnswered = true, isStopped = false, ending = "";

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/live`);
  socket.onopen = () => send({ hello: token });
  socket.onmessage = (event) => {
    for (const [topic, content] of Object.entries(JSON.parse(event.data))) TOPICS[topic]?.(content);
  };
  socket.onclose = ({ code }) => {
    cover(ending || (FINAL[code] ?? "The connection is lost; it is tried again."));
    if (!ending && !(code in FINAL)) setTimeout(connect, AGAIN_MS);
  };
}

function send(what) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(what));
}

const TOPICS = {
  welcome(content) {
    about = content;
    cover("");
    byId("name").textContent = document.title = about.title;
    byId("role").hidden = !about.is_watching;
    byId("stop").hidden = !(about.is_watching || about.has_stop);
  },
  step: showStep,
  live: (numbers) => showNumbers(byId("live"), numbers),
  watched: (numbers) => showNumbers(byId("watched"), numbers),
  notice: (sentence) => (byId("notice").textContent = sentence),
  stopped(is) {
    isStopped = is;
    document.body.classList.toggle("stopped", is);
    cover(is ? "Stopped." : "");
  },
  refused(sentence) {
    byId("notice").textContent = sentence;
    isAnswered = false;
    enable();
  },
  end: (sentence) => cover((ending = sentence)),
};

function showStep(given) {
  step = given;
  isAnswered = about.is_watching;
  byId("title").textContent = step.title;
  byId("text").replaceChildren(...step.text.split(/\n\n+/).filter(Boolean).map((each) => made("p", each)));
  byId("picture").hidden = !step.picture;
  byId("picture").src = step.picture || "data:,";
  byId("picture").alt = step.picture_words;
  showTable(step.table);
  byId("fields").replaceChildren(...step.fields.map(fieldOf));
  byId("buttons").replaceChildren(...step.buttons.map(buttonOf));
  byId("progress").hidden = !step.progress;
  byId("done").textContent = step.progress ? `${step.progress[0]} of ${step.progress[1]}` : "";
  if (step.progress) [byId("progress").value, byId("progress").max] = step.progress;
  shownMs = performance.now();
  requestAnimationFrame(() => (shownMs = performance.now())); // when it is seen
  showTime();
  enable();
  scrollTo(0, 0);
  byId("fields").querySelector("input")?.focus();
}

function showTable([heading, ...rows]) {
  byId("table").hidden = !heading;
  const line = (cells, tag) => made("tr", "", ...cells.map((cell) => made(tag, cell)));
  byId("table").replaceChildren(...(heading ? [line(heading, "th"), ...rows.map((row) => line(row, "td"))] : []));
}

function fieldOf({ key, label, choices }) {
  if (choices.length) {
    const rows = choices.map((choice) => {
      const input = named("input", key, { type: "radio", value: choice });
      return made("label", "", input, made("span", ` ${choice}`));
    });
    return classed("field", made("fieldset", "", made("legend", label), classed("row", made("div", "", ...rows))));
  }
  const input = named("input", key, { id: `field-${key}`, type: "text", inputMode: "decimal" });
  const words = made("label", label);
  words.htmlFor = input.id;
  return classed("field", made("div", "", words, classed("row", made("div", "", input))));
}

function buttonOf(button) {
  const made_ = made("button", button.label);
  made_.type = "button";
  made_.className = button.look;
  made_.dataset.key = button.key;
  if (button.shortcut) made_.append(made("kbd", KEYS[button.shortcut] ?? button.shortcut));
  made_.onclick = () => answer(button);
  return made_;
}

function answer(button) {
  if (isAnswered) return;
  isAnswered = true;
  const seconds = Math.max(0, performance.now() - shownMs) / 1000;
  const values = {};
  for (const { key } of step.fields) values[key] = byId("form").elements[key].value;
  send({ answer: { number: step.number, button: button.key, values, seconds } });
  enable();
}

function enable() {
  for (const each of byId("form").elements) each.disabled = isAnswered;
}

function stop() {
  if (!byId("stop").hidden) send({ stop: true });
}

function showTime() {
  byId("time").hidden = step.seconds === null;
  if (step.seconds === null) return;
  const left = Math.max(0, step.seconds - (performance.now() - shownMs) / 1000);
  byId("time-bar").value = left / step.seconds;
  byId("time-left").textContent = `${Math.ceil(left)} s left`;
  if (!left) {
    isAnswered = true;
    enable();
  }
}

function showNumbers(list, numbers) {
  const entries = Object.entries(numbers);
  while (list.children.length > 2 * entries.length) list.lastChild.remove();
  while (list.children.length < 2 * entries.length) list.append(made("dt", ""), made("dd", ""));
  entries.flat().forEach((text, k) => (list.children[k].textContent = text));
  byId("beside").hidden = !(byId("live").childElementCount + byId("watched").childElementCount);
}

function cover(sentence) {
  byId("cover").hidden = !sentence;
  byId("cover-text").textContent = sentence;
}

function made(tag, text, ...children) {
  const element = document.createElement(tag);
  element.textContent = text;
  element.append(...children);
  return element;
}

function named(tag, name, properties) {
  return Object.assign(document.createElement(tag), { name, ...properties });
}

function classed(name, element) {
  element.className = name;
  return element;
}

byId("stop").onclick = stop;
byId("form").onsubmit = (event) => event.preventDefault();
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") return stop();
  const isTyping = event.target.matches("input[type=text]");
  if (event.repeat || event.ctrlKey || event.altKey || event.metaKey || isStopped) return;
  if (isTyping && event.key !== "Enter") return;
  if (event.key === "Enter" && event.target.tagName === "BUTTON") return; // which it presses
  const button = step.buttons?.find(({ shortcut }) => shortcut === event.key);
  if (!button) return;
  event.preventDefault();
  answer(button);
});
setInterval(() => step.seconds && showTime(), 100);
connect();
