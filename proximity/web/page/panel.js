// The panel: state, numbers, parts, fingertips, and messages.

import { css, distanceColour, GREY } from "./colours.js";
import { MEANINGS, mm, shownDistance } from "./frames.js";
import { percentile } from "./link.js";
import { fingerName } from "./inputs/hand.js";

const EVERY_MS = 120;
const NOTICE_MS = 9000;
const LOOK = { OK: "good", DEGRADED: "good", STALE: "bad", STOPPING: "bad" }; // others: "warn"

export const byId = (id) => document.getElementById(id);

export class Panel {
  constructor() {
    this.lastMs = 0;
    this.rows = [];
    this.about = {};
    this.noticeTimer = 0;
  }

  setAbout(about) {
    this.about = about;
    byId("title").textContent = about.title;
    document.title = `${about.title} · proximity`;
    byId("fingers").classList.toggle("gloved", Boolean(about.drum_degrees));
  }

  /** Show a sentence; it disappears after a while, unless it is permanent. */
  say(sentence, stays = false) {
    const notice = byId("notice");
    notice.textContent = sentence;
    notice.hidden = !sentence;
    clearTimeout(this.noticeTimer);
    if (sentence && !stays) this.noticeTimer = setTimeout(() => (notice.hidden = true), NOTICE_MS);
  }

  cover(sentence) {
    byId("cover").hidden = !sentence;
    byId("cover-text").textContent = sentence;
  }

  /** Show a reading, or that of the probe; no more often than it can be read. */
  show(reading, link, isLogged, probe) {
    const now = performance.now();
    const { contacts, header } = reading;
    const isProbed = reading.state === "NO HANDS" && probe?.answer;
    const state = isProbed ? "OK" : reading.state;
    if (now - this.lastMs < EVERY_MS && state === this.state) return;
    Object.assign(this, { state, lastMs: now });
    const tracked = contacts.filter((contact) => contact.isKnown).length;
    const pill = byId("state");
    pill.textContent = state;
    pill.className = `pill ${LOOK[state] ?? "warn"}`;
    pill.hidden = Boolean(this.about.motion) && state === "NO HANDS"; // which a motion does not need
    document.body.classList.toggle("late", state === "LATE");
    document.body.classList.toggle("stale", state === "STALE" || state === "STOPPING");
    setText(byId("meaning"), pill.hidden ? "" : isProbed ? probe.hint : this.meaning(state, contacts, tracked));
    byId("numbers").parentElement.hidden = !contacts.length; // of hands
    this.showNumbers(reading, link, isLogged, header, contacts);
    this.showFingers(contacts, state);
  }

  meaning(state, contacts, tracked) {
    if (state in MEANINGS) return MEANINGS[state];
    const hand = contacts.length === 10 && tracked === 5 && (contacts[0].isKnown ? "left" : "right");
    const isWhole = hand && contacts.every(({ isKnown }, finger) => isKnown === (hand === "right" ? finger >= 5 : finger < 5));
    if (isWhole) return `The ${hand} hand is tracked.`;
    if (tracked < contacts.length) {
      return `${tracked || "No"} of ${contacts.length} fingers ${tracked === 1 ? "is" : "are"} tracked.`;
    }
    const isBounded = contacts.some((contact) => !contact.isExact && !contact.isFar);
    return isBounded ? "For a finger the budget allowed bounds only." : "Every finger is tracked.";
  }

  showNumbers(reading, link, isLogged, header, contacts) {
    const number = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)} ${unit}` : "—");
    const work = contacts.reduce((most, contact) => (contact.isKnown ? Math.max(most, contact.work) : most), 0);
    const rate = isLogged && header ? 1e9 / Number(header.period_ns) : link.rate.hz;
    const isKnown = reading.state !== "STALE" || isLogged;
    const isServed = header?.missed !== undefined;
    const hasPose = contacts.some((contact) => contact.isKnown); // without one the age is that of the tick
    const shown = [
      ["rate", number(isKnown ? rate : NaN, 0, "Hz")],
      ["age", number(isKnown && hasPose ? reading.ageMs : NaN, 1, "ms")],
      ["latency", isLogged || !isKnown ? "—" : number(percentile(link.latencies, 0.5), 1, "ms")],
      ["p99", isLogged || !isKnown ? "—" : number(percentile(link.latencies, 0.99), 1, "ms")],
      ...(isServed ? [["missed", isKnown ? `${header.missed}` : "—"]] : []),
      ["budget", isKnown ? `${work}${this.about.budget ? ` of ${this.about.budget}` : ""}` : "—"],
    ];
    const list = byId("numbers");
    if (list.childElementCount !== 2 * shown.length) {
      list.replaceChildren();
      for (const [name] of shown) list.append(made("dt", name), made("dd", ""));
    }
    shown.forEach(([, text], k) => setText(list.children[2 * k + 1], text));
  }

  showFingers(contacts, state) {
    const isStale = state === "STALE" || state === "STOPPING";
    const seen = contacts.filter((contact) => contact.isKnown || (isStale && this.wasSeen?.has(contact.finger)));
    if (!isStale) this.wasSeen = new Set(seen.map((contact) => contact.finger));
    byId("fingers-card").hidden = !seen.length;
    const body = byId("fingers").tBodies[0];
    while (body.rows.length > seen.length) body.deleteRow(-1);
    while (body.rows.length < seen.length) {
      const row = body.insertRow();
      for (let k = 0; k < 5; k++) row.insertCell();
      row.cells[0].append(made("span", "", "swatch"), made("span", ""));
    }
    seen.forEach((contact, k) => this.showFinger(body.rows[k].cells, contact, contacts.length));
  }

  showFinger(cells, contact, count) {
    cells[0].children[0].style.background = css(contact.isKnown ? distanceColour(contact.distance) : GREY);
    setText(cells[0].children[1], fingerName(contact.finger, count));
    setText(cells[1], shownDistance(contact));
    setText(cells[2], !contact.isKnown || contact.isExact ? "" : `${mm(contact.lower, 1)} … ${mm(contact.upper, 1)}`);
    const soon = contact.isKnown && contact.contactMs >= 0 && Number.isFinite(contact.contactMs);
    setText(cells[3], !soon ? "" : contact.contactMs === 0 ? "now" : `${Math.round(contact.contactMs)} ms`);
    setText(cells[4], [contact.mode.toLowerCase(), this.drumAngle(contact)].join(" ").trim());
  }

  /** The target angle of the finger's drum, in degrees; "" without a glove, or when retracted. */
  drumAngle({ finger, mode, contactBend }) {
    const angles = this.about.drum_degrees?.[finger];
    if (!angles || !Number.isFinite(contactBend) || mode === "RETRACT" || mode === "HOLD") return "";
    const place = Math.min(Math.max(contactBend, 0), 1) * (angles.length - 1);
    const k = Math.min(Math.floor(place), angles.length - 2);
    return `${(angles[k] + (angles[k + 1] - angles[k]) * (place - k)).toFixed(1)}°`;
  }

  showParts(parts, choose) {
    const list = byId("parts");
    while (list.children.length > parts.list.length) list.lastChild.remove();
    parts.list.forEach((part, k) => {
      const item = list.children[k] ?? list.appendChild(partItem());
      const [dot, name, eye] = item.children;
      dot.style.background = part.colour;
      setText(name, part.name);
      name.title = `${part.name}: ${part.about.face_count.toLocaleString("en")} faces`;
      name.setAttribute("aria-pressed", part === parts.picked);
      name.onclick = () => choose(part);
      setText(eye, part.object.visible ? "hide" : "show");
      eye.setAttribute("aria-label", `${part.object.visible ? "hide" : "show"} ${part.name}`);
      eye.onclick = () => parts.setVisible(part, !part.object.visible);
      item.classList.toggle("off", !part.object.visible);
    });
    const { face_count: all, shown_count: shown } = parts.about;
    byId("coarser").hidden = shown >= all;
    const number = (count) => count.toLocaleString("en").replaceAll(",", " ");
    byId("coarser").textContent = `Simplified display: ${number(shown)} of ${number(all)} faces. Distances are computed with all faces.`;
  }
}

function partItem() {
  const item = document.createElement("li");
  const name = made("button", "", "name");
  const eye = made("button", "", "eye");
  name.type = eye.type = "button";
  item.append(made("span", "", "dot"), name, eye);
  return item;
}

export function made(tag, text, kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Save a file through the browser. */
export function offer(content, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Whether a key belongs to a field, or to the browser. */
export const isTyped = ({ ctrlKey, metaKey, altKey, target, key }) =>
  ctrlKey || metaKey || altKey || target.matches?.("input[type=number], select") || (target.type === "range" && key.startsWith("Arrow"));

/** Buttons with one choice: [key, label], and a callback with the key. */
export function makeChoice(holder, choices, chosen, choose) {
  holder.replaceChildren();
  for (const [key, label] of choices) {
    const button = made("button", label);
    button.type = "button";
    button.setAttribute("role", "radio");
    button.dataset.key = key;
    button.onclick = () => choose(key);
    holder.append(button);
  }
  showChoice(holder, chosen);
}

export function showChoice(holder, chosen) {
  for (const button of holder.children) button.setAttribute("aria-checked", button.dataset.key === chosen);
}
