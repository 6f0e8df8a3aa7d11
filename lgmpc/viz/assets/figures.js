// Figures under the cursor: values, one time for all figures and the replay, zoom, curves that can be hidden. The
// pictures are whole without it; `lgmpc/viz/interaction.py` describes their axes and names their parts.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const WHOLE = [0, 1];
  const all = [];  // axes of all figures
  const make = (name, attributes, parent) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return parent ? parent.appendChild(element) : element;
  };
  const clamp = (value, low, high) => Math.max(low, Math.min(high, value));

  // Numbers of a path, its commands apart: matplotlib writes absolute ones with pairs of coordinates only.
  const parsed = (d) => d.match(/[A-Za-z]|-?[\d.]+(?:e-?\d+)?/g).map((each) => (/[A-Za-z]/.test(each) ? each : Number(each)));

  // The zoom of a part of a figure: a function of the new places of both coordinates.
  function movable(part, height) {
    const x = part.classList.contains("x"), y = part.classList.contains("y");
    const moves = [];
    const path = (element, offset) => {
      const numbers = parsed(element.getAttribute("d"));
      moves.push((atX, atY) => {
        let odd = true;
        element.setAttribute("d", numbers.map((each) => {
          if (typeof each === "string") return each;
          odd = !odd;
          return (odd ? (y ? atY(each + offset) - offset : each) : x ? atX(each) : each).toFixed(2);
        }).join(" "));
      });
    };
    for (const element of part.querySelectorAll("path")) if (!element.closest("defs")) path(element, 0);
    for (const element of part.querySelectorAll("use")) {
      const at = ["x", "y"].map((name) => Number(element.getAttribute(name)));
      const target = document.getElementById(element.getAttribute("xlink:href").slice(1));
      // Areas are drawn at the origin of matplotlib, below the picture; markers where they are.
      if (at[0] === 0 && Math.abs(at[1] - height) < 0.1) path(target, at[1]);
      else moves.push((atX, atY) => {
        if (x) element.setAttribute("x", atX(at[0]));
        if (y) element.setAttribute("y", atY(at[1]));
      });
    }
    return (atX, atY) => moves.forEach((move) => move(atX, atY));
  }

  class Axes {
    constructor(figure, about) {
      Object.assign(this, about, { figure, view: { x: WHOLE, y: WHOLE } });
      const [left, top, right, bottom] = about.box;
      Object.assign(this, { left, top, right, bottom, width: right - left, height: bottom - top });
      this.group = figure.svg.querySelector(`.axes.a${about.axes}`);
      const id = `${figure.name}-${about.axes}`;
      const clip = make("clipPath", { id }, figure.svg.querySelector("defs"));
      make("rect", { x: left, y: top, width: this.width, height: this.height }, clip);
      this.moves = [];
      this.texts = [];
      for (const part of this.group.querySelectorAll(".part")) {
        if (part.querySelector("text")) this.texts.push(this.text(part));
        else {
          for (const each of part.querySelectorAll("[clip-path]")) each.removeAttribute("clip-path");
          part.setAttribute("clip-path", `url(#${id})`);
          if (about.zoom) this.moves.push(movable(part, figure.height));
        }
      }
      this.curves = Object.entries(about.names).flatMap(([number, name]) =>
        [...this.group.querySelectorAll(`.part.c${number}`)].map((part) => this.curve(part, number, name)));
      this.ticks = make("g", {});
      const first = this.group.querySelector(".part");
      if (first) first.parentNode.insertBefore(this.ticks, first);
      this.cursor = make("line", { class: "cursor", y1: top, y2: bottom, visibility: "hidden" }, this.group);
    }

    // Its points as pieces, between gaps, in the coordinates of the picture.
    curve(part, number, name) {
      const pieces = [];
      for (const element of part.querySelectorAll("path")) {
        if (element.closest("defs")) continue;
        const numbers = parsed(element.getAttribute("d"));
        for (let i = 0; i < numbers.length; i += 1) {
          if (numbers[i] === "M") pieces.push([]);
          if (typeof numbers[i] === "string") continue;
          pieces[pieces.length - 1].push([numbers[i], numbers[i + 1]]);
          i += 1;
        }
      }
      const drawn = part.querySelector("path:not(defs path)");
      return { part, number, name, pieces, color: drawn ? drawn.style.stroke : "" };
    }

    text(part) {
      const at = [...part.classList].find((each) => each.startsWith("@")).slice(1).split(",").map(Number);
      return (atX, atY) => {
        const x = part.classList.contains("x") ? atX(at[0]) : at[0], y = part.classList.contains("y") ? atY(at[1]) : at[1];
        const dx = part.classList.contains("x") ? x - at[0] : 0, dy = part.classList.contains("y") ? y - at[1] : 0;
        const outside = (dx !== 0 && (x < this.left || x > this.right)) || (dy !== 0 && (y < this.top || y > this.bottom));
        part.setAttribute("transform", `translate(${dx} ${dy})`);
        part.setAttribute("visibility", outside ? "hidden" : "visible");
      };
    }

    holds([x, y]) { return x >= this.left && x <= this.right && y >= this.top && y <= this.bottom; }

    // Share of the whole range at a place in the picture as it is shown, and back.
    shareX(x) { const [a, b] = this.view.x; return a + ((x - this.left) / this.width) * (b - a); }
    shareY(y) { const [a, b] = this.view.y; return a + ((this.bottom - y) / this.height) * (b - a); }
    timeAt(x) { return this.x[0] + this.shareX(x) * (this.x[1] - this.x[0]); }

    show() {
      const [a, b] = this.view.x, [c, d] = this.view.y;
      const atX = (x) => this.left + (((x - this.left) / this.width - a) / (b - a)) * this.width;
      const atY = (y) => this.bottom - (((this.bottom - y) / this.height - c) / (d - c)) * this.height;
      this.moves.forEach((move) => move(atX, atY));
      this.texts.forEach((move) => move(atX, atY));
      const zoomed = { x: a > 0 || b < 1, y: c > 0 || d < 1 };
      this.ticks.replaceChildren();
      for (const axis of "xy") {
        for (const each of this.group.querySelectorAll(`.${axis}tick`)) each.style.display = zoomed[axis] ? "none" : "";
        if (zoomed[axis]) this.drawTicks(axis);
      }
    }

    drawTicks(axis) {
      const [low, high] = this[axis], [from, to] = this.view[axis].map((share) => low + share * (high - low));
      const room = axis === "x" ? this.width / 60 : this.height / 30;
      const rough = Math.abs(to - from) / Math.max(2, room), power = 10 ** Math.floor(Math.log10(rough));
      const step = power * [1, 2, 5, 10].find((each) => each * power >= rough);
      const sample = this.group.querySelector(`.${axis}tick text`);
      for (let k = Math.ceil(Math.min(from, to) / step); k * step <= Math.max(from, to) + 1e-9 * step; k += 1) {
        const share = (k * step - from) / (to - from);
        const x = this.left + share * this.width, y = this.bottom - share * this.height;
        const ends = axis === "x" ? { x1: x, x2: x, y1: this.top, y2: this.bottom } : { y1: y, y2: y, x1: this.left, x2: this.right };
        make("line", { class: "grid", ...ends }, this.ticks);
        if (!sample) continue;
        const label = make("text", { style: sample.getAttribute("style") }, this.ticks);
        label.setAttribute("x", axis === "x" ? x : sample.getAttribute("x"));
        label.setAttribute("y", axis === "x" ? sample.getAttribute("y") : y + 3.8);
        label.textContent = String(Number((k * step).toPrecision(9)));
      }
    }

    digits() {
      const range = Math.abs(this.y[1] - this.y[0]) * (this.view.y[1] - this.view.y[0]);
      return clamp(3 - Math.round(Math.log10(range || 1)), 0, 6);
    }

    words(y) { return this.value(y).toFixed(this.digits()).replace(/^-(0(?:\.0*)?)$/, "$1"); }

    value(y) { return this.y[0] + ((this.bottom - y) / this.height) * (this.y[1] - this.y[0]); }

    visible() { return this.curves.filter((curve) => !this.figure.hidden.has(curve.number)); }

    // Rows of [colour, name, text] for the curves at a time.
    valuesAt(time) {
      const x = this.left + ((time - this.x[0]) / (this.x[1] - this.x[0])) * this.width;
      return this.visible().flatMap(({ pieces, name, color }) => {
        const piece = pieces.find((each) => each[0][0] <= x + 0.01 && x - 0.01 <= each[each.length - 1][0]);
        if (!piece) return [];
        let low = 0, high = piece.length - 1;
        while (high - low > 1) {
          const middle = (low + high) >> 1;
          if (piece[middle][0] <= x) low = middle; else high = middle;
        }
        const [a, b] = [piece[low], piece[high]];
        const share = b[0] > a[0] ? clamp((x - a[0]) / (b[0] - a[0]), 0, 1) : 0;
        return [[color, name, `${this.words(a[1] + share * (b[1] - a[1]))} ${this.unitOnly()}`]];
      });
    }

    unitOnly() { return this.unit.includes(", ") ? this.unit.slice(this.unit.lastIndexOf(", ") + 2) : this.unit; }

    // The row of the point nearest to a place, for axes that are not over time.
    nearest([x, y]) {
      const place = [this.left + this.shareX(x) * this.width, this.bottom - this.shareY(y) * this.height];
      let best = null, least = 18;
      for (const { pieces, name, color } of this.visible()) {
        for (const point of pieces.flat()) {
          const far = Math.hypot(point[0] - place[0], point[1] - place[1]);
          if (far < least) [best, least] = [{ point, name, color }, far];
        }
      }
      if (!best) return null;
      const [px, py] = best.point;
      const across = this.x[0] + ((px - this.left) / this.width) * (this.x[1] - this.x[0]);
      let words = `${Number(across.toPrecision(4))}, ${this.words(py)}`;
      if (this.kind === "polar") {  // ahead is up, left is left
        const east = px - (this.left + this.right) / 2, north = (this.top + this.bottom) / 2 - py;
        const radius = (Math.hypot(east, north) / (this.width / 2)) * this.y[1];
        words = `${radius.toPrecision(3)} at ${Math.round((Math.atan2(-east, north) * 180) / Math.PI)}°`;
      } else if (this.kind === "levels") {
        words = `${this.levels[String(Math.round(across))]}: ${this.value(py).toFixed(1)} %`;
      }
      return [best.color, best.name, words];
    }
  }

  class Figure {
    constructor(svg, number) {
      Object.assign(this, { svg, name: `figure-${number}`, hidden: new Set(), height: svg.viewBox.baseVal.height });
      this.box = svg.closest("figure");
      this.axes = JSON.parse(svg.dataset.axes).map((about) => new Axes(this, about));
      this.note = this.box.appendChild(document.createElement("div"));
      this.note.className = "note";
      this.note.hidden = true;
      this.selection = make("rect", { class: "selection", visibility: "hidden" }, svg);
      for (const key of svg.querySelectorAll(".key")) this.makeKey(key);
      this.listen();
    }

    place(event) {
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      return [point.x, point.y];
    }

    makeKey(key) {
      const number = [...key.classList].find((each) => /^c\d+$/.test(each)).slice(1);
      const { x, y, width, height } = key.getBBox();
      make("rect", { x: x - 3, y: y - 5, width: width + 6, height: height + 10, fill: "transparent" }, key);
      if (key.querySelector("text")) {
        key.setAttribute("tabindex", "0");
        key.setAttribute("role", "button");
        key.setAttribute("aria-pressed", "true");
      }
      const toggle = () => {
        const hide = !this.hidden.has(number);
        if (hide) this.hidden.add(number); else this.hidden.delete(number);
        for (const each of this.svg.querySelectorAll(`.c${number}`)) {
          each.classList.toggle("off", hide);
          if (each.hasAttribute("role")) each.setAttribute("aria-pressed", String(!hide));
        }
      };
      key.addEventListener("click", toggle);
      key.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        toggle();
      });
    }

    at(place) { return this.axes.filter((axes) => axes.holds(place)); }

    point(event) {
      const place = this.place(event), here = this.at(place);
      if (here.length === 0) { this.note.hidden = true; return; }
      if (here[0].kind === "time") {
        const time = here[0].timeAt(place[0]);
        showTime(time);
        this.say(event, `${time.toFixed(3)} s`, here.flatMap((axes) => axes.valuesAt(time)));
      } else {
        const row = here[0].nearest(place);
        if (row) this.say(event, "", [row]); else this.note.hidden = true;
      }
    }

    say(event, title, rows) {
      const frame = this.box.getBoundingClientRect(), x = event.clientX - frame.left, y = event.clientY - frame.top;
      this.note.replaceChildren();
      if (title) this.note.appendChild(document.createElement("b")).textContent = title;
      for (const [color, name, text] of rows) {
        const row = this.note.appendChild(document.createElement("div"));
        row.appendChild(document.createElement("i")).style.background = color;
        row.append(name ? `${name}  ${text}` : text);
      }
      this.note.hidden = false;
      const left = x > frame.width / 2 ? x - this.note.offsetWidth - 14 : x + 14;
      const lowest = Math.max(0, frame.height - this.note.offsetHeight - 4);
      this.note.style.left = `${this.box.scrollLeft + Math.max(0, left)}px`;
      this.note.style.top = `${clamp(y - this.note.offsetHeight / 2, 0, lowest)}px`;
    }

    listen() {
      const { svg } = this;
      let start = null, moved = false, pinch = null;
      svg.addEventListener("pointermove", (event) => {
        if (!start) { if (event.pointerType === "mouse") this.point(event); return; }
        const place = this.place(event);
        moved = moved || Math.hypot(place[0] - start.place[0], place[1] - start.place[1]) > 4;
        if (!moved) return;
        this.note.hidden = true;
        if (start.pan) pan(start.axes, start.view, start.place, place);
        else this.mark(start, place);
      });
      svg.addEventListener("pointerdown", (event) => {
        moved = false;
        const place = this.place(event), [axes] = this.at(place);
        if (event.pointerType !== "mouse" || event.button !== 0 || !axes || !axes.zoom || event.target.closest(".key")) return;
        start = { axes, place, pan: event.shiftKey, view: { ...axes.view } };
        svg.setPointerCapture(event.pointerId);
        event.preventDefault();
      });
      const end = (event) => {
        if (start && moved && !start.pan && event.type === "pointerup") this.zoomTo(start, this.place(event));
        this.selection.setAttribute("visibility", "hidden");
        start = null;
      };
      svg.addEventListener("pointerup", end);
      svg.addEventListener("pointercancel", end);
      svg.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") this.note.hidden = true; });
      svg.addEventListener("click", (event) => {
        if (moved || event.target.closest(".key")) return;
        this.point(event);
        const [axes] = this.at(this.place(event));
        if (axes && axes.kind === "time") seekReplay(axes.timeAt(this.place(event)[0]));
      });
      svg.addEventListener("dblclick", (event) => {
        for (const axes of this.at(this.place(event))) show(axes, WHOLE, WHOLE);
      });
      svg.addEventListener("wheel", (event) => {
        const [axes] = this.at(this.place(event));
        if (!event.ctrlKey || !axes || !axes.zoom) return;
        event.preventDefault();
        scale(axes, axes.shareX(this.place(event)[0]), Math.exp(0.003 * clamp(event.deltaY, -200, 200)));
      }, { passive: false });
      const fingers = (event) => {
        const [a, b] = [...event.touches].map((touch) => this.place(touch));
        return { gap: Math.max(8, Math.abs(a[0] - b[0])), middle: (a[0] + b[0]) / 2, place: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
      };
      svg.addEventListener("touchstart", (event) => {
        const [axes] = event.touches.length === 2 ? this.at(fingers(event).place) : [];
        pinch = axes && axes.zoom ? { axes, view: axes.view.x, ...fingers(event) } : null;
      }, { passive: true });
      svg.addEventListener("touchmove", (event) => {
        if (!pinch || event.touches.length !== 2) return;
        event.preventDefault();
        const { axes, view, gap, middle } = pinch, now = fingers(event);
        const width = clamp(((view[1] - view[0]) * gap) / now.gap, 0.02, 1);
        const held = view[0] + ((middle - axes.left) / axes.width) * (view[1] - view[0]);
        const low = clamp(held - ((now.middle - axes.left) / axes.width) * width, 0, 1 - width);
        show(axes, [low, low + width], axes.view.y);
      }, { passive: false });
    }

    // The part of the axes between two places: all of its height for a flat movement, all of its width for a steep one.
    span({ axes, place }, now) {
      const x = [place[0], now[0]].map((each) => clamp(each, axes.left, axes.right)).sort((a, b) => a - b);
      const y = [place[1], now[1]].map((each) => clamp(each, axes.top, axes.bottom)).sort((a, b) => a - b);
      const flat = y[1] - y[0] < 12 || !axes.zoom.includes("y"), steep = x[1] - x[0] < 12 || !axes.zoom.includes("x");
      return { x: steep && !flat ? [axes.left, axes.right] : x, y: flat ? [axes.top, axes.bottom] : y };
    }

    mark(start, now) {
      const { x, y } = this.span(start, now);
      const place = { x: x[0], y: y[0], width: x[1] - x[0], height: y[1] - y[0], visibility: "visible" };
      for (const [key, value] of Object.entries(place)) this.selection.setAttribute(key, value);
    }

    zoomTo(start, now) {
      const { axes } = start, { x, y } = this.span(start, now);
      show(axes, x.map((each) => axes.shareX(each)), [axes.shareY(y[1]), axes.shareY(y[0])]);
    }
  }

  // Axes over the same time have the same part of it in view.
  function show(axes, x, y) {
    const alike = (each) => each.kind === "time" && axes.kind === "time" && each.x[0] === axes.x[0] && each.x[1] === axes.x[1];
    const least = 0.002;
    if (x[1] - x[0] < least || y[1] - y[0] < least) return;
    for (const each of all) {
      if (each !== axes && !alike(each)) continue;
      each.view = { x, y: each === axes ? y : each.view.y };
      each.show();
    }
    if (shown !== null) showTime(shown);
  }

  function scale(axes, center, factor) {
    const width = clamp((axes.view.x[1] - axes.view.x[0]) * factor, 0.02, 1);
    const share = (center - axes.view.x[0]) / (axes.view.x[1] - axes.view.x[0]);
    const low = clamp(center - share * width, 0, 1 - width);
    show(axes, [low, low + width], axes.view.y);
  }

  function pan(axes, view, from, to) {
    const shift = (range, share) => {
      const low = clamp(range[0] - share * (range[1] - range[0]), 0, 1 - (range[1] - range[0]));
      return [low, low + range[1] - range[0]];
    };
    show(axes, shift(view.x, (to[0] - from[0]) / axes.width), shift(view.y, -(to[1] - from[1]) / axes.height));
  }

  let shown = null;
  function showTime(time) {
    shown = time;
    for (const axes of all) {
      if (axes.kind !== "time") continue;
      const [a, b] = axes.view.x, share = ((time - axes.x[0]) / (axes.x[1] - axes.x[0]) - a) / (b - a);
      const x = axes.left + share * axes.width;
      axes.cursor.setAttribute("x1", x);
      axes.cursor.setAttribute("x2", x);
      axes.cursor.setAttribute("visibility", share >= 0 && share <= 1 ? "visible" : "hidden");
    }
  }

  // A replay that was loaded shows the time of a click, and its own time in the figures.
  function seekReplay(time) {
    const frame = document.querySelector(".replay iframe"), replay = frame && frame.contentWindow.lgmpc;
    if (replay && replay.seek) replay.seek(time - replay.start);
  }
  addEventListener("message", (event) => {
    const frame = document.querySelector(".replay iframe");
    if (frame && event.source === frame.contentWindow && typeof event.data.lgmpcTime === "number") showTime(event.data.lgmpcTime);
  });

  const figures = [...document.querySelectorAll("svg[data-axes]")].map((svg, number) => new Figure(svg, number));
  all.push(...figures.flatMap((figure) => figure.axes));
  if (all.some((axes) => axes.zoom)) {
    const hint = document.createElement("p");
    hint.className = "hint";
    hint.textContent = matchMedia("(pointer: coarse)").matches
      ? "Tap: values, and the replay goes there. Two fingers: zoom. Double tap: all of it. A name in a legend: hide or show."
      : "Point: values. Click: the replay goes there. Drag: zoom; with Shift: move. Ctrl + wheel: zoom. Double click: all of it."
        + " A name in a legend: hide or show.";
    figures.find((figure) => figure.axes.some((axes) => axes.zoom)).box.before(hint);
  }
})();
