// The page: waits for the render, then lets controls, picture and region follow one tree of changes.
// @ts-check
import { Anew } from "./anew.js";
import { Changes } from "./changes.js";
import { Compare } from "./compare.js";
import { drawControls, make } from "./controls.js";
import { Designs } from "./designs.js";
import { Findings } from "./findings.js";
import { Drawing, Picture, ask } from "./picture.js";
import { Orbit, TURNED } from "./orbit.js";
import { Photographs } from "./photographs.js";
import { Region } from "./region.js";
import { Tour } from "./tour.js";

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const VIEWS = [["developed", "Developed"], ["raw", "Raw mosaic"], ["clip", "Clipping"], ["noise", "Signal to noise"], ["eye", "Eye"], ["clay", "Clay"], ["part", "Parts"], ["depth", "Depth"], ["porphyrin", "Porphyrin map"]];
const TOOLS = [["off", "Off"], ["rectangle", "Rectangle"], ["polygon", "Polygon"], ["part", "Part"], ["orbit", "Turn in 3-D"]];
/** How often the page looks how far a render is, ms. */
const LOOK = 150;

/** @param {string} text @param {boolean} [needsRender] whether a new render would show what is wanted */
function say(text, needsRender = false) {
  byId("message").hidden = text === "";
  byId("ways").hidden = !needsRender;
  if (byId("message-text").textContent !== text) byId("message-text").textContent = text;
}

/** A row of choices, of which one holds. @param {string} id @param {string[][]} choices @param {(value: string) => void} chosen */
function radios(id, choices, chosen) {
  const buttons = choices.map(([value, title]) => {
    const button = make("input", { type: "radio", name: id, value });
    button.addEventListener("change", () => chosen(value));
    return make("label", {}, [button, make("span", { textContent: title })]);
  });
  byId(id).append(make("div", { className: "choices" }, buttons));
  return (/** @type {string} */ value) => {
    for (const button of byId(id).querySelectorAll("input")) button.checked = button.value === value;
  };
}

/** Waits for the render that is in work. */
async function wait() {
  byId("stop").onclick = () => ask("/api/stop", {});
  for (;;) {
    const subject = await (await fetch("/api/subject")).json();
    byId("subject").textContent = subject.title || subject.name || "";
    if (["ready", "photographs", "designs"].includes(subject.stage)) return subject;
    if (subject.error) throw new Error(subject.error);
    if (byId("photographs").hidden) turnTo("waiting");
    byId("said").textContent = subject.said;
    byId("share").value = subject.share;
    await new Promise((resolve) => setTimeout(resolve, LOOK));
  }
}

/** What of the page is shown: the simulation, the wait for it, photographs or designs. @param {"bench" | "waiting" | "photographs" | "designs"} place */
function turnTo(place) {
  for (const other of ["bench", "waiting", "photographs", "designs"]) byId(other).hidden = other !== place;
  byId("changes").hidden = place !== "bench";
  byId("go-simulation").setAttribute("aria-pressed", String(place !== "photographs"));
  byId("go-photographs").setAttribute("aria-pressed", String(place === "photographs"));
}

const photographs = new Photographs(say, () => turnTo("photographs"));
byId("go-photographs").addEventListener("click", () => {
  turnTo("photographs");
  if (!photographs.about) photographs.load();
});

/** @param {any} subject */
function begin(subject) {
  if (subject.stage === "photographs") {
    byId("go-simulation").hidden = true;
    byId("subject").textContent = "Raw frames of a camera";
    turnTo("photographs");
    photographs.load();
    return;
  }
  if (subject.stage === "designs") {
    byId("go-simulation").textContent = "Designs";
    byId("go-simulation").addEventListener("click", () => turnTo("designs"));
    turnTo("designs");
    new Designs(subject, say);
    return;
  }
  byId("go-simulation").addEventListener("click", () => turnTo("bench"));
  if (byId("photographs").hidden) turnTo("bench");
  const changes = new Changes();
  changes.read(location.hash);
  if (!location.hash) {
    for (const text of subject.set) changes.now.set[text.slice(0, text.indexOf("="))] = text.slice(text.indexOf("=") + 1);
  }
  const complete = () => {
    if (!subject.captures.includes(changes.shown.capture)) changes.shown.capture = subject.analyzed ?? subject.captures.at(-1);
    if (!VIEWS.some(([view]) => view === changes.shown.view)) changes.shown.view = "developed";
  };
  complete();

  const picture = new Picture(changes, say);
  const drawing = new Drawing(picture, changes);
  picture.drawing = drawing;
  const region = new Region(changes, picture, subject);
  const compare = new Compare(changes, picture, say);
  const findings = new Findings(changes, picture);
  const drag = {
    /** @type {number | null} */
    lastExposure: null,
    begin: () => {
      changes.remember();
      [picture.isHeld, picture.isCoarse] = [true, false];
    },
    end: () => {
      picture.isHeld = false;
      changed("set");
    },
  };
  let updateControls = drawControls(byId("groups"), subject.groups, changes, drag);
  // Another render may have other lights and fluorophores to change
  new Anew(changes, picture, say, async () => {
    const groups = await (await ask("/api/controls", { set: changes.list() })).json();
    if (JSON.stringify(groups) === JSON.stringify(subject.groups)) return;
    subject.groups = groups;
    updateControls = drawControls(byId("groups"), groups, changes, drag);
    updateControls();
  });
  picture.onshown = () => {
    drag.lastExposure = Number(picture.facts?.exposure_ms?.toPrecision(3)) || null;
    compare.refresh();
  };

  const show = (/** @type {"capture" | "view"} */ what) => (/** @type {string} */ value) => {
    changes.shown[what] = value;
    if (orbit.isOn && what === "view" && !TURNED.includes(value)) useTool("off");
    changed("set");
  };
  const markCapture = radios("captures", subject.captures.map((/** @type {string} */ name) => [name, name]), show("capture"));
  const markView = radios("views", subject.analyzed ? VIEWS : VIEWS.slice(0, -1), show("view"));
  const markTool = radios("tools", TOOLS, (tool) => useTool(tool));
  const orbit = new Orbit(changes, picture, say);
  /** @param {string} tool */
  function useTool(tool) {
    drawing.use(tool);
    markTool(tool);
    if (tool === "orbit" && !TURNED.includes(changes.shown.view)) show("view")("clay");
    orbit.use(tool === "orbit");
  }
  const tool = matchMedia("(pointer: coarse)").matches ? "off" : "rectangle";
  useTool(tool);

  /** @param {"set" | "place"} what */
  function changed(what) {
    // A region belongs to the frame on which it was drawn
    if (what === "place" && picture.facts) changes.fit({ px: picture.facts.frame_px, mm: picture.facts.sensor_mm });
    updateControls();
    byId("undo").disabled = !changes.canUndo;
    region.refresh();
    findings.refresh();
    // While a control is dragged the picture follows, and the rest at its end
    if (picture.isHeld && picture.isBusy) return picture.refresh();
    markCapture(changes.shown.capture);
    markView(changes.shown.view);
    listChanges(changes);
    byId("redo").disabled = changes.future.length === 0;
    byId("reset").disabled = changes.list().length === 0 && !changes.now.place;
    byId("copy").disabled = false;
    if (!picture.isHeld) history.replaceState(null, "", `#${changes.fragment()}`);
    if (what === "set" || changes.shown.view === "porphyrin") picture.refresh();
    drawing.redraw();
    if (orbit.isOn) orbit.refresh();
  }
  changes.onchange = changed;
  changes.onsettled = () => {
    if (changes.shown.view === "porphyrin") picture.refresh();
    findings.refresh();
  };
  window.addEventListener("hashchange", () => {
    if (location.hash.slice(1) === changes.fragment()) return;
    changes.remember();
    changes.read(location.hash);
    complete();
    changed("set");
  });
  buttons(changes);
  changed("set");
  new Tour().begin();
}

/** @param {Changes} changes */
function listChanges(changes) {
  const entries = changes.list().map((text) => {
    const path = text.slice(0, text.indexOf("="));
    const back = make("button", { type: "button", className: "back", textContent: "↺" });
    back.setAttribute("aria-label", `Take back the change of ${path}`);
    back.addEventListener("click", () => {
      changes.remember();
      changes.set(path, undefined);
    });
    return make("li", {}, [make("code", { textContent: text }), back]);
  });
  byId("changed").replaceChildren(...(entries.length ? entries : [make("li", { className: "note", textContent: "None: the experiment as it was rendered." })]));
}

/** Has the report of what is shown made, and offers it. @param {Changes} changes */
async function makeReport(changes) {
  const links = ["made-open", "made-save"].map(byId);
  for (const link of links) link.hidden = true;
  byId("made-state").textContent = "Making the report of all captures …";
  byId("made").showModal();
  try {
    await ask("/api/report", { set: changes.list(), place: changes.place() });
    byId("made-state").textContent = "One page, with the experiment and all changes in it.";
    for (const link of links) link.hidden = false;
  } catch (error) {
    byId("made-state").textContent = /** @type {Error} */ (error).message;
  }
}

// The address holds the changes: the way to the controls leaves it alone
document.querySelector(".skip")?.addEventListener("click", (event) => {
  event.preventDefault();
  const place = ["controls", "photographs", "designs"].map(byId).find((found) => !found.closest("[hidden]"));
  place.tabIndex = -1;
  place.focus();
});

/** @param {Changes} changes */
function buttons(changes) {
  byId("undo").addEventListener("click", () => changes.undo());
  byId("redo").addEventListener("click", () => changes.redo());
  byId("back").addEventListener("click", () => changes.undo());
  byId("reset").addEventListener("click", () => changes.reset());
  document.addEventListener("keydown", (event) => {
    const isText = event.target instanceof HTMLElement && event.target.matches("input[type=number], input:not([type]), textarea");
    if (isText || byId("bench").hidden || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    if (event.shiftKey) changes.redo();
    else changes.undo();
  });
  byId("any").addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const { path, value } = byId("any").elements;
    changes.remember();
    changes.set(path.value.trim(), value.value.trim());
  });
  const dialog = byId("toml");
  const text = async () => (await (await ask("/api/toml", { set: changes.list(), place: changes.place() })).json()).toml;
  const pressed = (/** @type {string} */ id, /** @type {() => Promise<void>} */ act) =>
    byId(id).addEventListener("click", () => act().catch((/** @type {Error} */ error) => say(error.message)));
  pressed("copy", async () => {
    byId("toml-text").value = await text();
    dialog.showModal();
    byId("toml-text").select();
    byId("toml-text").scrollTop = 0;
  });
  pressed("save", async () => {
    const href = URL.createObjectURL(new Blob([await text()], { type: "application/toml" }));
    make("a", { href, download: "experiment.toml" }).click();
    setTimeout(() => URL.revokeObjectURL(href), 60_000);
  });
  pressed("report", () => makeReport(changes));
  byId("made-close").addEventListener("click", () => byId("made").close());
  byId("toml-copy").addEventListener("click", async () => {
    byId("toml-text").select();
    await navigator.clipboard.writeText(byId("toml-text").value).catch(() => document.execCommand("copy"));
    byId("toml-copy").textContent = "Copied";
    setTimeout(() => (byId("toml-copy").textContent = "Copy"), 1500);
  });
  byId("toml-close").addEventListener("click", () => dialog.close());
}

wait().then(begin).catch((error) => {
  byId("waiting").hidden = true;
  say(error.message);
});
