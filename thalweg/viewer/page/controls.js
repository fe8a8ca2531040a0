// Keys, buttons and gamepads as four numbers: climb, turn left, forward, left, each from -1 to 1.

const KEYS = {
  KeyW: [2, 1], KeyS: [2, -1], KeyA: [1, 1], KeyD: [1, -1], ArrowLeft: [1, 1], ArrowRight: [1, -1],
  ArrowUp: [0, 1], ArrowDown: [0, -1], KeyQ: [3, 1], KeyE: [3, -1],
};
const WORDS = [["descend", "climb"], ["turn right", "turn left"], ["back", "forward"], ["right", "left"]];
const DEAD = 0.15, POLL_MS = 40;

export class Controls {
  /** `change` is called with the four numbers whenever they change, `command` with the code of any other key. */
  constructor(change, command) {
    this.change = change;
    this.held = new Map();
    this.cruise = false;
    this.last = "0,0,0,0";
    window.addEventListener("keydown", (event) => this.key(event, true, command));
    window.addEventListener("keyup", (event) => this.key(event, false, command));
    window.addEventListener("blur", () => this.release());
    for (const button of document.querySelectorAll("[data-hold]")) this.pad(button);
    setInterval(() => this.tell(), POLL_MS);
  }

  key(event, down, command) {
    const inField = event.target.matches?.("input:not([type=checkbox]), select, textarea");
    if (event.ctrlKey || event.metaKey || event.altKey || inField) return;
    const place = KEYS[event.code];
    if (place) {
      event.preventDefault();
      if (down) this.held.set(event.code, place);
      else this.held.delete(event.code);
      this.tell();
      if (down) command("flight", event.repeat);
    } else if (down && !event.repeat && command(event.key.length === 1 ? event.key.toLowerCase() : event.code)) {
      event.preventDefault();
    }
  }

  pad(button) {
    const [branch, sign] = button.dataset.hold.split(" ").map(Number), name = `pad ${branch} ${sign}`;
    const release = () => {
      this.held.delete(name);
      button.classList.remove("held");
      this.tell();
    };
    button.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      button.setPointerCapture(event.pointerId);
      this.held.set(name, [branch, sign]);
      button.classList.add("held");
      this.tell();
      this.touched?.();
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(end, release);
  }

  release() {
    this.held.clear();
    this.tell();
  }

  /** The four numbers of now. */
  units() {
    const units = [0, 0, this.cruise ? 1 : 0, 0];
    for (const [branch, sign] of this.held.values()) units[branch] += sign;
    for (const pad of navigator.getGamepads?.() || []) {
      if (!pad?.connected || pad.axes.length < 4) continue;
      const stick = pad.axes.map((axis) => (Math.abs(axis) < DEAD ? 0 : -axis));
      [stick[1], stick[0], stick[3], stick[2]].forEach((value, branch) => { units[branch] += value; });
    }
    return units.map((value) => Math.round(100 * Math.max(-1, Math.min(1, value))) / 100 + 0);
  }

  /** Tell what is held also if it is the same: a server that is new to the page has heard nothing. */
  repeat() {
    this.last = "";
    this.tell();
  }

  tell() {
    const units = this.units();
    if (units.join() === this.last) return;
    this.last = units.join();
    this.change(units);
  }
}

/** What four numbers do, in words; `back` is the word for less than no step forward. */
export function inWords(units, back) {
  return units.map((value, branch) => {
    if (value === 0) return "";
    return branch === 2 && value < 0 ? back : WORDS[branch][value > 0 ? 1 : 0];
  }).filter(Boolean);
}
