// The page: a scene, hands over it, and the distance of every fingertip.

import { Fingers } from "./fingers.js";
import { HandShape } from "./inputs/hand.js";
import { Headset, whyNot } from "./inputs/headset.js";
import { MouseHand } from "./inputs/mouse_hand.js";
import { Probe } from "./inputs/probe.js";
import { RecordedHand } from "./inputs/recorded_hand.js";
import { Link } from "./link.js";
import { LocalLink } from "./local_link.js";
import { LocalScene, documentOf } from "./local_scene.js";
import { Motion } from "./motion.js";
import { Panel, byId, isTyped, makeChoice, showChoice } from "./panel.js";
import { Parts } from "./parts.js";
import { Stage } from "./stage.js";
import { Timeline } from "./timeline.js";
import { Tools } from "./tools/tools.js";

const CHOICES = [["probe", "Probe"], ["mouse", "Hand"], ["replay", "Recorded"], ["headset", "Headset"], ["none", "None"]];
const WITHOUT_HANDS = ["probe", "none"];

class Page {
  constructor(link, local) {
    this.local = local;
    this.panel = new Panel();
    this.stage = new Stage(byId("canvas"));
    this.link = link;
    this.parts = new Parts(this.stage, this.link);
    this.parts.addEventListener("placed", () => (local.version += 1));
    this.fingers = new Fingers(this.stage);
    this.probe = new Probe(this.stage, this.parts, local);
    this.tools = new Tools(this.stage, this.parts, local, this.panel, this.probe);
    this.shapes = { left: new HandShape(this.stage.root), right: new HandShape(this.stage.root) };
    this.paths = new Map(); // of fingers, as sent
    this.tracked = new Set(); // fingers sent last
    this.input = "none";
    this.feeds = false;
    this.listen();
    this.stage.updates.add(() => this.update());
  }

  listen() {
    const on = (name, act) => this.link.addEventListener(name, (event) => act(event.detail));
    on("welcome", (about) => this.welcome(about));
    on("notice", (sentence) => this.panel.say(sentence));
    on("feeds", (feeds) => this.setRole(feeds));
    on("closed", ({ sentence, isFinal }) => {
      if (isFinal) this.panel.cover(sentence);
      else this.panel.say(sentence, true);
    });
    on("frame", (header) => header && this.parts.follow(Number(header.start_ns) / 1e6));
    addEventListener("keydown", (event) => {
      if (event.code === "KeyH" && !isTyped(event)) this.choose(this.input === "mouse" ? "probe" : "mouse");
    });
    this.parts.addEventListener("changed", () => this.panel.showParts(this.parts, (part) => this.tools.choosePart(part)));
  }

  welcome(about) {
    this.about = about;
    if (about.log) this.link.frames.isLogged = true;
    this.panel.setAbout(about);
    this.panel.say("");
    this.fingers.setRadii(about.radii ?? new Array(about.finger_count).fill(0.007));
    if (about.log && !this.timeline) {
      this.timeline = new Timeline(this.link, about.log);
      this.stage.updates.add(() => this.timeline.update());
      if (about.log.notes.length) this.panel.say(about.log.notes.join(" "));
    }
    this.makeInputs();
    this.setRole(about.feeds);
    if (this.parts.isLoaded) this.parts.restore();
    else if (about.has_geometry) this.load();
    else this.panel.cover("");
  }

  async load() {
    this.isLoading = true;
    this.panel.cover("Loading the parts …");
    await Promise.all([this.parts.load(this.local.ask("geometry")), this.local.open()]);
    this.isLoading = false;
    this.panel.cover("");
    this.tools.readLink();
    const { clashes, points, unit, motion } = this.about;
    if (motion) this.motion = new Motion(this.stage, this.parts, this.local, motion);
    if (clashes) this.tools.clashes.show(clashes);
    this.tools.points.unit = unit;
    if (points) this.tools.points.show(points.name, new Float64Array(await this.local.ask("points")));
  }

  makeInputs() {
    const before = this.inputs ? this.wanted : null;
    for (const each of Object.values(this.inputs ?? {})) if (!(each instanceof Headset)) each.stop();
    const send = (found, atMs = performance.now()) => this.send(found, atMs);
    const headset = this.inputs?.headset ?? new Headset(this.stage, this.parts, send);
    const isLocal = this.link instanceof LocalLink, first = isLocal ? "probe" : "mouse";
    headset.onEnd = () => this.choose(first);
    this.inputs = {
      probe: this.probe,
      mouse: this.inputs?.mouse ?? new MouseHand(this.stage, send),
      replay: new RecordedHand(this.about.recording, send),
      headset,
    };
    for (const each of Object.values(this.inputs)) each.hasPaths = !isLocal; // a glove behind a service needs them
    const { recording, may_pose: mayPose, has_geometry: hasParts } = this.about;
    const isOffered = { probe: hasParts, mouse: mayPose, replay: mayPose && recording, headset: mayPose, none: true };
    const choices = CHOICES.filter(([key]) => isOffered[key]);
    makeChoice(byId("inputs"), choices, this.input, (key) => this.choose(key));
    this.wanted = before ?? (this.about.first_input || first);
  }

  /** Whether this page feeds the service, or only displays another source. */
  setRole(feeds) {
    this.feeds = feeds && this.about.may_pose;
    this.tools.mayMove = feeds && this.about.may_move;
    this.parts.mayHide = feeds && this.about.may_hide;
    if (this.feeds) return void this.choose(this.wanted);
    if (this.about.log) this.choose("none", "The hands are those of the log.");
    else if (!this.about.may_pose) this.choose("none", "This page only shows: hands come from another program.");
    else this.choose("none", "Another page sends the hands. Choose a source here to take over.");
  }

  /** Select the source of hands; *why* replaces the usual hint. */
  async choose(key, why) {
    if (!this.about) return;
    if (!this.feeds && !WITHOUT_HANDS.includes(key)) {
      if (!this.about.may_pose) return;
      this.wanted = key;
      return this.link.say({ feed: true });
    }
    let hint = why ?? (WITHOUT_HANDS.includes(key) ? "" : this.inputs[key].hint);
    if (key === "headset") {
      const reason = await whyNot();
      if (reason) {
        byId("input-hint").textContent = reason;
        return;
      }
    }
    for (const [name, input] of Object.entries(this.inputs)) if (name !== key) await input.stop();
    this.input = key;
    if (why === undefined) this.wanted = key; // a choice with a reason is not the user's
    try {
      await this.inputs[key]?.start();
    } catch (failure) {
      hint = `The headset did not start: ${failure.message}`;
    }
    showChoice(byId("inputs"), key);
    byId("input-hint").textContent = hint;
  }

  /** Send fingertips; those no longer present are sent as not tracked. */
  send(found, atMs) {
    if (!this.feeds) return;
    const now = new Set(found.map((each) => each.finger));
    const gone = [...this.tracked].filter((finger) => !now.has(finger)).map((finger) => ({ finger }));
    const fitting = found.filter((each) => each.finger < this.about.finger_count);
    this.paths.clear();
    for (const each of fitting) if (each.corners) this.paths.set(each.finger, each.corners);
    this.tracked = now;
    this.link.sendPoses([...fitting, ...gone], atMs);
  }

  /** The state at this instant. */
  get reading() {
    const reading = this.link.at(performance.now());
    return this.isLoading ? { ...reading, state: "LOADING" } : reading;
  }

  update() {
    const { link, stage } = this;
    const isLogged = Boolean(this.about?.log);
    const reading = this.reading;
    const { contacts, state } = reading;
    if (contacts.some((contact) => contact.isKnown)) stage.wake();
    this.fingers.show(reading, this.paths);
    this.probe.update(this.tools.held);
    this.panel.show(reading, link, isLogged, this.probe);
    const active = this.inputs?.[this.input];
    if (active instanceof Headset) active.contacts = contacts;
    const hands = active instanceof Headset ? active.hands : new Map([["right", active?.joints]]);
    for (const side of ["left", "right"]) {
      const joints = hands.get(side);
      if (joints) this.shapes[side].show(joints, state, active instanceof Headset ? 0.6 : 0.25);
      else this.shapes[side].hide();
    }
    this.tools.update();
    stage.controls.enabled = !this.tools.held;
  }
}

/** Request page contents by name from the server, with the token. */
async function served(name) {
  const answer = await fetch(`./shown/${name}`, { headers: { Authorization: `Bearer ${token}` } });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.arrayBuffer();
}

/** Show distances computed by a service, or by this page, according to the welcome. */
async function begin(ask) {
  const local = new LocalScene(ask);
  const welcome = documentOf(await ask("welcome"));
  window.page = new Page(welcome ? new LocalLink(welcome, local) : new Link(token), local); // for tests, too
}

const token = new URLSearchParams(location.hash.slice(1)).get("token");
const cover = (sentence) => new Panel().cover(sentence);
if (innerWidth <= 640) byId("side").open = byId("points-card").open = byId("clashes-card").open = false; // as in style.css
if (!document.createElement("canvas").getContext("webgl2")) {
  cover("This browser cannot draw in three dimensions: WebGL 2 is missing or switched off.");
} else if (!window.saved && !token) cover("The address has no token: open the address that proximity view printed.");
else begin(window.saved ?? served).catch((failure) => cover(failure.message));
