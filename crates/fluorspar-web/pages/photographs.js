// Photographs: taken in, looked at, drawn upon, asked about, and saved as a table that `analyze` takes.
// @ts-check
import { shortNumber } from "./chart.js";
import { make } from "./controls.js";
import { Drawing, ask, draw } from "./picture.js";

/** @typedef {{rectangle_px?: number[], polygon_px?: number[][], mask_runs?: number[], part?: string}} Place */
/** @typedef {{name: string, place: Place, verdict: string, told?: any, mask?: Uint8Array}} PhotoRegion */
/** @typedef {{id: number, name: string, patient: string, visit: string, capture: string, size: number[] | null, regions: PhotoRegion[], is_edited?: boolean}} Photo */

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const NAMES = ["tongue", "lip", "lesion"];
/** Colors by Okabe and Ito. */
const INKS = ["#56b4e9", "#e69f00", "#cc79a7", "#009e73", "#f0e442"];
const REST = 250;

/** Runs of pixels outside and inside, in turn. @param {Uint8Array} mask */
function runsOf(mask) {
  const runs = [];
  let [inside, start] = [0, 0];
  for (let at = 0; at < mask.length; at++) {
    if (mask[at] === inside) continue;
    runs.push(at - start);
    [inside, start] = [mask[at], at];
  }
  if (inside) runs.push(mask.length - start);
  return runs;
}

/** Regions by hand, with a brush, too. */
class Painting extends Drawing {
  /** @param {any} picture @param {any} changes @param {HTMLCanvasElement} canvas @param {() => PhotoRegion | null} region */
  constructor(picture, changes, canvas, region) {
    super(picture, changes, canvas);
    this.region = region;
    this.isPainting = false;
    /** Where the stroke was last. */
    this.last = [0, 0];
  }

  get paints() {
    return this.tool === "brush" || this.tool === "erase";
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (!this.paints) return super.press(event);
    if (!this.picture.facts || event.button !== 0) return;
    if (!this.region()) this.picture.addRegion("lesion");
    const region = this.region();
    if (!region) return;
    event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    const [width, height] = this.picture.facts.frame_px;
    region.mask ??= new Uint8Array(width * height);
    region.place = { part: region.place.part, mask_runs: [] };
    this.isPainting = true;
    this.last = this.place(event);
    this.stroke(event);
  }

  /** @param {PointerEvent} event */
  move(event) {
    if (!this.paints) return super.move(event);
    if (this.isPainting) this.stroke(event);
  }

  /** @param {PointerEvent} event */
  release(event) {
    if (!this.paints) return super.release(event);
    const region = this.region();
    if (!this.isPainting || !region?.mask) return;
    this.isPainting = false;
    this.changes.draw({ mask_runs: runsOf(region.mask) });
  }

  /** @param {PointerEvent} event */
  stroke(event) {
    const [width, height] = this.picture.facts.frame_px;
    const mask = /** @type {Uint8Array} */ (this.region()?.mask);
    const radius = (Number(byId("brush-size").value) / 200) * Math.min(width, height);
    const value = this.tool === "brush" ? 1 : 0;
    // A quick stroke has few places
    const [from, to] = [this.last, this.place(event)];
    const steps = Math.max(Math.ceil((2 * Math.hypot(to[0] - from[0], to[1] - from[1])) / Math.max(radius, 1)), 1);
    for (let step = 1; step <= steps; step++) {
      const [x, y] = [0, 1].map((axis) => from[axis] + ((to[axis] - from[axis]) * step) / steps);
      this.disc(mask, [x, y], radius, value);
    }
    this.last = to;
    this.redraw();
  }

  /** @param {Uint8Array} mask @param {number[]} middle @param {number} radius @param {number} value */
  disc(mask, [x, y], radius, value) {
    const [width, height] = this.picture.facts.frame_px;
    for (let row = Math.max(Math.ceil(y - radius), 0); row < Math.min(y + radius, height); row++) {
      const half = Math.sqrt(Math.max(radius ** 2 - (row + 0.5 - y) ** 2, 0));
      mask.fill(value, row * width + Math.max(Math.round(x - half), 0), row * width + Math.min(Math.round(x + half), width));
    }
  }

  /** All regions of the photograph, that which is open in front. */
  redraw() {
    super.redraw();
    const facts = this.picture.facts;
    if (!facts) return;
    const pen = this.canvas.getContext("2d");
    const scale = this.canvas.width / facts.frame_px[0];
    for (const [number, region] of this.picture.regions().entries()) {
      const ink = INKS[number % INKS.length];
      [pen.strokeStyle, pen.lineWidth] = [ink, 2.5 * (window.devicePixelRatio || 1)];
      const { rectangle_px: box, polygon_px: corners } = region.place;
      pen.beginPath();
      if (box) pen.rect(box[0] * scale, box[1] * scale, box[2] * scale, box[3] * scale);
      corners?.forEach(([x, y], i) => (i ? pen.lineTo(x * scale, y * scale) : pen.moveTo(x * scale, y * scale)));
      if (corners) pen.closePath();
      pen.stroke();
      // A map shows what was painted by itself
      if (region.mask && region.place.mask_runs && this.picture.view !== "porphyrin") this.fill(pen, region.mask, facts.frame_px, ink);
    }
  }

  /** @param {CanvasRenderingContext2D} pen @param {Uint8Array} mask @param {number[]} size @param {string} ink */
  fill(pen, mask, [width, height], ink) {
    const layer = new OffscreenCanvas(width, height);
    const own = /** @type {OffscreenCanvasRenderingContext2D} */ (layer.getContext("2d"));
    const pixels = own.createImageData(width, height);
    const [red, green, blue] = [1, 3, 5].map((at) => Number.parseInt(ink.slice(at, at + 2), 16));
    for (let at = 0; at < mask.length; at++) if (mask[at]) pixels.data.set([red, green, blue, 110], 4 * at);
    own.putImageData(pixels, 0, 0);
    pen.drawImage(layer, 0, 0, this.canvas.width, this.canvas.height);
  }
}

export class Photographs {
  /** @param {(text: string) => void} say @param {() => void} open */
  constructor(say, open) {
    this.say = say;
    this.open = open;
    /** @type {Photo[]} */
    this.all = [];
    /** @type {Photo | null} */
    this.shown = null;
    /** @type {PhotoRegion | null} */
    this.region = null;
    this.view = "developed";
    this.facts = null;
    this.about = null;
    this.serial = 0;
    /** The region that is asked about, and that which was last. @type {PhotoRegion | null} */
    this.asking = null;
    /** @type {PhotoRegion | null} */
    this.mapped = null;
    this.now = { place: null };
    /** Tells this page from others that save. */
    this.page = crypto.randomUUID();
    this.isSaved = true;
    window.addEventListener("beforeunload", (event) => this.isSaved || event.preventDefault());
    this.painting = new Painting(this, this, byId("photo-drawing"), () => this.region);
    byId("photo-files").addEventListener("change", () => this.add(byId("photo-files").files));
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      if (event.dataTransfer?.files.length) this.add(event.dataTransfer.files);
    });
    byId("photo-experiment").addEventListener("change", () => this.load(byId("photo-experiment").value));
    byId("photo-view").addEventListener("change", () => {
      this.view = byId("photo-view").value;
      this.show();
    });
    byId("photo-tool").addEventListener("change", () => this.painting.use(byId("photo-tool").value));
    byId("photo-save").addEventListener("submit", (/** @type {Event} */ event) => {
      event.preventDefault();
      this.save();
    });
    byId("photo-box").addEventListener("submit", (/** @type {Event} */ event) => {
      event.preventDefault();
      const field = (/** @type {string} */ name) => Math.max(Math.round(Number(byId("photo-box").elements[name].value)), 0);
      this.draw({ rectangle_px: [field("column"), field("row"), Math.max(field("width"), 1), Math.max(field("height"), 1)] });
    });
    for (const name of [...NAMES, "other"]) {
      const button = make("button", { type: "button", textContent: `Add ${name}` });
      button.addEventListener("click", () => this.addRegion(name));
      byId("photo-add").append(button);
    }
    new ResizeObserver(() => this.layOut()).observe(byId("photo-viewport"));
    this.painting.use("polygon");
  }

  /** @param {string} [experiment] */
  async load(experiment) {
    try {
      this.about = await (await ask("/api/photographs", experiment ? { experiment } : {})).json();
    } catch (error) {
      return this.tell(/** @type {Error} */ (error).message);
    }
    byId("photo-experiment").replaceChildren(...this.about.experiments.map((/** @type {string[]} */ [value, title]) => make("option", { value, textContent: `${value}: ${title}` })));
    byId("photo-experiment").value = this.about.experiment;
    if (this.about.folder && !byId("photo-folder").value) byId("photo-folder").value = this.about.folder;
    for (const { id, name, capture, patient, visit } of this.about.frames) {
      const known = this.all.find((photo) => photo.id === id);
      if (!known) this.all.push({ id, name, patient, visit, capture, size: null, regions: [] });
      else {
        if (!this.about.captures.includes(known.capture)) known.capture = capture;
        if (!known.is_edited) Object.assign(known, { patient, visit });
      }
    }
    const first = this.all.find(({ capture }) => capture === this.about.analyzed) ?? this.all[0];
    this.forget();
    this.choose(this.shown ?? first ?? null);
  }

  /** @param {string} text */
  tell(text) {
    byId("photo-message").textContent = text;
  }

  /** Takes files in, descriptions before the frames that they describe. @param {FileList} files */
  async add(files) {
    this.open();
    const list = [...files].sort((a, b) => Number(b.name.endsWith(".json")) - Number(a.name.endsWith(".json")));
    const doubts = [];
    for (const file of list) {
      this.tell(`Reading ${file.name} …`);
      try {
        const response = await fetch(`/api/photographs/file/${encodeURIComponent(file.name)}`, { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file });
        const text = await response.text();
        if (!response.ok && !text.startsWith("{")) throw new Error(text);
        const told = JSON.parse(text);
        if (!response.ok) doubts.push(told.error);
        doubts.push(...(told.doubts ?? []));
      } catch (error) {
        doubts.push(`${file.name}: ${/** @type {Error} */ (error).message}`);
      }
    }
    byId("photo-files").value = "";
    this.shown = null;
    await this.load(this.about?.experiment);
    this.tell(doubts.join("\n"));
  }

  /** @param {Photo | null} photo */
  choose(photo) {
    // Nothing is drawn on a picture that is not there yet
    if (photo !== this.shown) {
      this.facts = null;
      this.painting.cancel();
      for (const id of ["photo-picture", "photo-drawing"]) byId(id).getContext("2d").clearRect(0, 0, byId(id).width, byId(id).height);
    }
    this.shown = photo;
    this.region = photo?.regions[0] ?? null;
    byId("photo-empty").hidden = Boolean(photo);
    byId("photo-work").hidden = !photo;
    this.list();
    this.show();
  }

  regions() {
    return this.shown?.regions ?? [];
  }

  list() {
    const rows = this.all.map((photo) => {
      const open = make("button", { type: "button", textContent: photo.name });
      open.setAttribute("aria-pressed", String(photo === this.shown));
      open.addEventListener("click", () => this.choose(photo));
      const field = (/** @type {"patient" | "visit"} */ key) => {
        const input = make("input", { value: photo[key], size: 6 });
        input.setAttribute("aria-label", `${key} of ${photo.name}`);
        input.addEventListener("change", () => {
          photo[key] = input.value;
          photo.is_edited = true;
          this.isSaved = false;
          this.again();
        });
        return input;
      };
      const capture = make("select", {}, this.about.captures.map((/** @type {string} */ name) => make("option", { value: name, textContent: name })));
      capture.value = photo.capture;
      capture.setAttribute("aria-label", `capture of ${photo.name}`);
      capture.addEventListener("change", () => {
        photo.capture = capture.value;
        if (photo === this.shown) this.show();
        this.again();
      });
      const row = make("tr");
      for (const cell of [open, field("patient"), field("visit"), capture]) row.append(make("td", {}, [cell]));
      return row;
    });
    byId("photo-list").replaceChildren(...rows);
    this.listRegions();
  }

  listRegions() {
    const entries = this.regions().map((region, number) => {
      const mark = make("span", { className: "mark" });
      mark.style.backgroundColor = INKS[number % INKS.length];
      const open = make("button", { type: "button" }, [mark, region.name]);
      open.setAttribute("aria-pressed", String(region === this.region));
      open.addEventListener("click", () => {
        this.region = region;
        this.listRegions();
        this.estimateOpen();
      });
      const part = make("select", {}, [make("option", { value: "", textContent: "no known tissue" }),
        ...this.about.parts.map((/** @type {string} */ name) => make("option", { value: name, textContent: name.replaceAll("_", " ") }))]);
      part.value = region.place.part ?? "";
      part.setAttribute("aria-label", `tissue of ${region.name}`);
      part.addEventListener("change", () => {
        region.place = { ...region.place, part: part.value };
        this.estimate(region);
      });
      const verdict = make("select", {}, [["", "not judged"], ["right", "right"], ["wrong", "wrong"]].map(([value, textContent]) => make("option", { value, textContent })));
      verdict.value = region.verdict;
      verdict.setAttribute("aria-label", `verdict on ${region.name}`);
      verdict.addEventListener("change", () => {
        region.verdict = verdict.value;
        this.isSaved = false;
      });
      const gone = make("button", { type: "button", className: "back", textContent: "✕" });
      gone.setAttribute("aria-label", `Remove ${region.name}`);
      gone.addEventListener("click", () => {
        if (this.shown) this.shown.regions = this.regions().filter((other) => other !== region);
        if (this.region === region) this.region = null;
        this.isSaved = false;
        this.listRegions();
        this.painting.redraw();
      });
      const lines = region.told?.lines ?? [];
      const text = region.told?.error ?? lines[0]?.trim() ?? (!isDrawn(region.place) ? "Draw it on the photograph." : region === this.region ? "Estimating …" : "Choose it for the estimate.");
      const further = make("details", { hidden: !lines.length }, [make("summary", { textContent: "All findings" }),
        make("ul", {}, [...lines.slice(1), ...(region.told?.warnings ?? []).map((/** @type {string} */ note) => `Note: ${note}`)].map((/** @type {string} */ line) => make("li", { textContent: line.trim() })))]);
      return make("li", {}, [make("div", { className: "row" }, [open, part, verdict, gone]), make("p", { className: "verdict", textContent: text }), further]);
    });
    byId("photo-regions").replaceChildren(...entries);
    byId("photo-box").hidden = !this.region;
  }

  /** @param {string} name */
  addRegion(name) {
    if (!this.shown) return;
    const wanted = name === "other" ? window.prompt("Name of the region") : name;
    if (!wanted) return;
    const taken = (/** @type {string} */ text) => this.regions().some((region) => region.name === text);
    let own = wanted;
    for (let number = 2; taken(own); number++) own = `${wanted} ${number}`;
    const parts = this.about.parts;
    const part = parts.find((/** @type {string} */ known) => known.includes(wanted)) ?? "";
    this.region = { name: own, place: { part }, verdict: "" };
    this.shown.regions.push(this.region);
    this.listRegions();
  }

  /** Takes a shape that was drawn; a region of its own where none is open. @param {Place} place */
  draw(place) {
    if (!this.region) this.addRegion("lesion");
    const region = this.region;
    if (!region) return;
    if (!place.mask_runs) region.mask = undefined;
    region.place = { ...place, part: region.place.part };
    this.isSaved = false;
    this.painting.redraw();
    this.estimate(region);
  }

  /** Frames may belong to others now, or to another camera: what was estimated holds no more. */
  forget() {
    this.serial++;
    this.asking = null;
    for (const { regions } of this.all) for (const region of regions) region.told = undefined;
  }

  again() {
    this.forget();
    this.listRegions();
    this.estimateOpen();
  }

  /** Estimates the open region where it is not told; for a map, where another one was asked about since. */
  estimateOpen() {
    const region = this.region;
    if (!region || !isDrawn(region.place) || region === this.asking) return;
    if (!region.told || (this.view === "porphyrin" && region !== this.mapped && !region.told.error)) this.estimate(region);
  }

  /** @param {PhotoRegion} region */
  async estimate(region) {
    const photo = this.shown;
    if (!photo?.size || !isDrawn(region.place)) return;
    const serial = ++this.serial;
    this.asking = region;
    region.told = undefined;
    this.listRegions();
    await new Promise((resolve) => setTimeout(resolve, REST));
    if (serial !== this.serial) return;
    const visit = this.all.filter((other) => other.patient === photo.patient && other.visit === photo.visit && (other === photo || other.capture !== photo.capture));
    let told;
    const frames = visit.filter((other, at) => other === photo || visit.findIndex(({ capture }) => capture === other.capture) === at).map(({ id, capture }) => [capture, id]);
    try {
      told = await (await ask("/api/photographs/estimate", { experiment: this.about.experiment, id: photo.id, frames, size: photo.size, name: region.name, place: region.place })).json();
    } catch (error) {
      told = { error: /** @type {Error} */ (error).message };
    }
    if (serial !== this.serial) return;
    this.asking = null;
    [region.told, this.mapped] = [told, region];
    if (photo !== this.shown) return;
    this.listRegions();
    if (this.view === "porphyrin") this.show();
  }

  async show() {
    const photo = this.shown;
    if (!photo) return;
    byId("photo-viewport").setAttribute("aria-busy", "true");
    try {
      const body = { experiment: this.about.experiment, id: photo.id, capture: photo.capture, view: this.view };
      const facts = await draw(body, byId("photo-picture"), "/api/photographs/picture");
      if (photo !== this.shown) return;
      this.facts = facts;
      photo.size = facts.frame_px;
      byId("photo-picture").setAttribute("aria-label", `Photograph ${photo.name}, ${this.view}, ${facts.frame_px.join(" by ")} pixels`);
      byId("photo-facts").textContent = `${facts.frame_px.join(" × ")} px, ${shortNumber(facts.exposure_ms)} ms, ${facts.clipped_percent.toFixed(1)} % clipped, bright pixels ${shortNumber(facts.bright_dn)} of ${shortNumber(facts.full_scale_dn)} DN above black`
        + (facts.legend ? `. ${facts.legend.label}: dark ${facts.legend.ends[0]}, yellow ${facts.legend.ends[1]}; ${facts.legend.note}` : "");
      this.layOut();
      if (byId("photo-message").textContent.startsWith("Reading")) this.tell("");
    } catch (error) {
      this.tell(/** @type {Error} */ (error).message);
    }
    byId("photo-viewport").setAttribute("aria-busy", "false");
    this.estimateOpen();
  }

  layOut() {
    if (!this.facts) return;
    const [width, height] = this.facts.frame_px;
    const scale = Math.min(byId("photo-viewport").clientWidth / width, Math.max(window.innerHeight - 260, 300) / height);
    for (const layer of [byId("photo-picture"), byId("photo-drawing")]) {
      layer.style.width = `${width * scale}px`;
      layer.style.height = `${height * scale}px`;
    }
    this.painting.redraw();
  }

  async save() {
    const unread = this.all.find(({ size, regions }) => !size && regions.some(({ place }) => isDrawn(place)));
    if (unread) return this.tell(`${unread.name} can't be read, so its regions can't be saved. Remove them, or bring the file back.`);
    const frames = this.all.map(({ id, patient, visit, capture, size, regions }) => ({
      id, patient, visit, capture, size: size ?? [0, 0],
      regions: regions.filter(({ place }) => isDrawn(place)).map(({ name, place, verdict }) => ({ name, place, verdict })),
    }));
    try {
      const told = await (await ask("/api/photographs/save", { folder: byId("photo-folder").value.trim(), page: this.page, frames })).json();
      this.isSaved = true;
      this.tell(`Saved in ${told.folder}: ${told.files.join(", ")}\nAll estimates as a table: fluorspar analyze "${told.folder}" --experiment ${this.about.experiment}`);
    } catch (error) {
      this.tell(/** @type {Error} */ (error).message);
    }
  }
}

/** @param {Place} place */
function isDrawn(place) {
  return Boolean(place.rectangle_px || place.polygon_px || place.mask_runs?.length);
}
