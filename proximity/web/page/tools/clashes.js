// Clashing parts: listed with the deepest first, and shown without the others.

import * as THREE from "three";
import { mm } from "../frames.js";
import { Label } from "../labels.js";
import { byId, made, setText } from "../panel.js";

const CUBIC_MM = 1e9; // in a cubic metre
const SIZE = 0.006; // of the ball at the deepest point, of its distance from the eyes

export class Clashes {
  constructor(stage, parts) {
    Object.assign(this, { stage, parts });
    this.list = []; // { names, deepest, depth, volume, point }, m, scene frame
    this.chosen = null;
    this.mark = new THREE.Group();
    stage.root.add(this.mark);
    byId("clashes").onkeydown = (event) => this.key(event);
  }

  /** List clashes, the deepest first. */
  show(list) {
    this.list = list;
    byId("clashes-card").hidden = false;
    const count = list.length === 1 ? "1 clash" : `${list.length} clashes`;
    setText(byId("clashes-name"), list.length ? `${count}, ${list.length > 1 ? "the deepest " : ""}${mm(list[0].deepest)} mm` : "No clash");
    byId("clashes-note").hidden = !list.length;
    byId("clashes").replaceChildren(...list.map((clash) => this.row(clash)));
  }

  row(clash) {
    const item = made("li", ""), button = made("button", "");
    const numbers = made("dl", "");
    const volume = clash.volume === null ? "unknown" : `${figures(CUBIC_MM * clash.volume)} mm³`;
    const values = [["deepest", `${mm(clash.deepest)} mm`], ["way out", `${mm(clash.depth)} mm`], ["volume", volume]];
    for (const [name, value] of values) {
      const pair = made("div", "");
      pair.append(made("dt", name), made("dd", value));
      numbers.append(pair);
    }
    button.type = "button";
    button.title = clash.names.join("\n");
    button.setAttribute("aria-pressed", false);
    button.onclick = () => this.choose(clash === this.chosen ? null : clash);
    const [first, second] = clash.names.map((name) => made("span", name, "name"));
    button.append(first, " ", second, numbers);
    item.append(button);
    return item;
  }

  /** View the two parts of a clash, with the others faint; null: all parts, from the previous view. */
  choose(clash) {
    const { stage, parts } = this, { camera, controls } = stage;
    if (clash === this.chosen) return;
    if (!this.chosen) this.view = [camera.position.clone(), controls.target.clone()];
    this.chosen = clash;
    [...byId("clashes").querySelectorAll("button")].forEach((button, k) => button.setAttribute("aria-pressed", this.list[k] === clash));
    this.mark.clear();
    const shown = clash && clash.names.map((name) => parts.named(name));
    parts.fade(shown);
    if (!clash) return stage.look(...this.view);
    stage.frame(parts.bounds(shown));
    if (clash.point) this.draw(clash, SIZE * camera.position.distanceTo(controls.target));
  }

  /** Mark the deepest point, which is inside both parts, through them. */
  draw({ point, deepest }, size) {
    const material = new THREE.MeshBasicMaterial({ color: 0xff6b4c, depthTest: false, toneMapped: false });
    const ball = new THREE.Mesh(new THREE.SphereGeometry(size, 16, 12), material);
    ball.renderOrder = 18;
    const label = new Label({ height: 4 * size, avoids: true });
    label.show(`${mm(deepest)} mm`);
    label.anchor(0.5, -0.6);
    for (const object of [ball, label.object]) {
      object.position.fromArray(point);
      this.mark.add(object);
    }
  }

  /** Choose the clash above or below by the arrow keys. */
  key(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation(); // the view does not turn
    const buttons = [...byId("clashes").querySelectorAll("button")], at = buttons.indexOf(event.target) + step;
    if (!buttons[at]) return;
    buttons[at].focus();
    this.choose(this.list[at]);
  }
}

/** A number with three digits, or with all before the point. */
const figures = (value) => (value >= 100 ? value.toFixed(0) : `${+value.toPrecision(3)}`);
