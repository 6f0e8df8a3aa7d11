"use strict";
// Puts the packed scene into the meshcat viewer and drives its animation from the time line.
const lgmpc = { ready: start().catch(report) };
window.lgmpc = lgmpc;

async function start() {
  if (!window.DecompressionStream) throw new Error("This page needs a browser from 2023 or later.");
  const { content, resolve } = await unpack(document.getElementById("payload").textContent);
  let viewer;
  try {
    viewer = new MeshCat.Viewer(document.getElementById("pane"));
  } catch (error) {
    throw new Error(`This page needs WebGL, which the browser does not offer here (${error.message}).`);
  }
  for (const command of content.commands) viewer.handle_command(resolve(command));
  const { THREE } = MeshCat;
  const keyLight = viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object;
  keyLight.shadow.mapSize.set(2048, 2048);
  viewer.scene_tree.find(["overlay"]).object.traverse((node) => { node.castShadow = false; });  // no part of the world
  viewer.scene.fog = new THREE.Fog(...content.fog);
  aim(viewer, keyLight, content.camera);
  const player = new Player(viewer, content, resolve(content.animations));
  describe(content);
  addLegend(viewer, content.legend);
  const fit = () => {
    // A window too narrow for the framing steps back.
    viewer.camera.zoom = Math.min(1, window.innerWidth / window.innerHeight / content.camera.aspect);
    viewer.set_dirty();
    player.draw();
  };
  window.addEventListener("resize", fit);
  viewer.set_3d_pane_size();
  fit();
  Object.assign(lgmpc, { viewer, seek: (time) => player.seek(time, true), duration: content.duration, start: content.start });
  const wanted = /^#t=([0-9.]+)$/.exec(location.hash);
  if (wanted) player.seek(Number(wanted[1]), true);
  else player.play();
}

// Through the viewer's orbit controls, whose target is in the axes of the page's world (y up); the light's is, too.
function aim(viewer, keyLight, { fov, near, far, position, target, floor }) {
  Object.assign(viewer.camera, { fov, near, far });
  viewer.camera.position.set(...position);
  viewer.controls.target.set(...target);
  viewer.controls.update();
  keyLight.target.position.set(target[0], floor, target[2]);
  keyLight.target.updateMatrixWorld();
}

// The payload is base64 of gzip of [length, JSON, arrays]; {"$array": [type, offset, count]} stands for a typed array.
async function unpack(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const length = Number(new DataView(buffer).getBigUint64(0, true));
  const content = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const types = { Float32Array, Int16Array, Uint16Array, Uint32Array };
  const resolve = (value) => {
    if (value === null || typeof value !== "object") return value;
    if (value.$array) return new types[value.$array[0]](buffer, 8 + length + value.$array[1], value.$array[2]);
    for (const key of Object.keys(value)) value[key] = resolve(value[key]);
    return value;
  };
  return { content, resolve };
}

class Player {
  constructor(viewer, content, animations) {
    this.viewer = viewer;
    this.content = content;
    this.canvas = document.getElementById("timeline");
    this.button = document.getElementById("play");
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    for (const animation of animations) animation.path = animation.path.split("/").filter((part) => part);
    // The viewer's own clock stays stopped: this one has a speed, repeats, and can be dragged.
    viewer.set_animation(animations, { play: true, repetitions: 1 });
    viewer.animator.pause();
    for (const action of viewer.animator.actions) action.setLoop(MeshCat.THREE.LoopRepeat, Infinity);
    this.listen();
    this.seek(0, false);
    let last = performance.now();
    const tick = (now) => {
      if (this.playing) {
        const next = this.time + (this.speed * Math.min(now - last, 100)) / 1000;
        this.seek(next >= content.duration ? 0 : next, false);
      }
      last = now;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  listen() {
    this.button.onclick = () => (this.playing ? this.pause() : this.play());
    document.getElementById("speed").onchange = (event) => (this.speed = Number(event.target.value));
    const drag = (event) => {
      const box = this.canvas.getBoundingClientRect();
      this.seek(((event.clientX - box.left) / box.width) * this.content.duration, true);
    };
    this.canvas.onpointerdown = (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      drag(event);
    };
    this.canvas.onpointermove = (event) => event.buttons && drag(event);
    window.addEventListener("keydown", (event) => {
      if (event.target.tagName === "SELECT" || event.target.tagName === "INPUT") return;
      if (event.code === "Space") this.button.click();
      else if (event.code === "ArrowRight") this.seek(this.time + (event.shiftKey ? 0.2 : 0.02), true);
      else if (event.code === "ArrowLeft") this.seek(this.time - (event.shiftKey ? 0.2 : 0.02), true);
      else return;
      event.preventDefault();
    });
    this.button.onkeyup = (event) => event.code === "Space" && event.preventDefault();
  }

  play() {
    this.playing = true;
    this.button.classList.add("playing");
  }

  pause() {
    this.playing = false;
    this.button.classList.remove("playing");
  }

  seek(time, stop) {
    if (stop) this.pause();
    // A hair before the end, because a loop's end is its start.
    this.time = Math.max(0, Math.min(time, this.content.duration - 1e-4));
    this.viewer.animator.seek(this.time);
    this.viewer.animator.display_progress(this.time);
    this.follow();
    this.draw();
  }

  // Picture shown at this time.
  get picture() {
    const { time } = this.content.series;
    const next = time.findIndex((t) => t > this.time);
    return Math.max(0, (next < 0 ? time.length : next) - 1);
  }

  // A robot that walks away takes the camera along, wherever the user has turned it to, and the lights, whose axes are
  // the scene's (z up).
  follow() {
    const moves = this.content.camera.follow;
    if (moves.length === 0) return;
    const time = this.content.series.time, k = this.picture, next = Math.min(k + 1, time.length - 1);
    const share = next > k ? (this.time - time[k]) / (time[next] - time[k]) : 0;
    const now = moves[k].map((value, axis) => value + share * (moves[next][axis] - value));
    const delta = new MeshCat.THREE.Vector3(...now.map((value, axis) => value - (this.moved || [0, 0, 0])[axis]));
    this.viewer.camera.position.add(delta);
    this.viewer.controls.target.add(delta);
    const find = (path) => this.viewer.scene_tree.find(path).object;
    find(["Lights"]).position.add(new MeshCat.THREE.Vector3(delta.x, -delta.z, delta.y));
    const { target } = find(["Lights", "SpotLight", "<object>"]);
    target.position.add(delta);
    target.updateMatrixWorld();
    this.moved = now;
  }

  draw() {
    const { series, pushes, start } = this.content;
    const k = this.picture;
    document.getElementById("now").textContent = (start + this.time).toFixed(2);
    document.getElementById("readout").textContent =
      [...series.states.slice(k, k + 1), ...series.curves.map((c) => `${c.label} ${c.values[k].toFixed(c.digits)}${c.unit}`)]
        .join("\n");
    const badge = document.getElementById("badge");
    const push = pushes.find((p) => this.time >= p.start && this.time < p.end);
    badge.classList.toggle("on", push !== undefined);
    if (push) badge.textContent = push.label;
    this.drawTimeline();
  }

  // A bar for each foot while it is on the ground, and a mark at each time at which something is to be reached.
  drawContacts(g, x, bottom) {
    const { phases = [], marks = [] } = this.content;
    const row = bottom / Math.max(phases.length, 1);
    phases.forEach((foot, k) => {
      g.fillStyle = "rgba(0, 158, 115, .17)";
      for (const [start, end] of foot.spans) g.fillRect(x(start), k * row + 1, Math.max(x(end) - x(start) - 1, 1), row - 2);
      g.fillStyle = "rgba(0, 100, 72, .8)";
      g.textAlign = "left";
      if (row >= 10) g.fillText(foot.name, 4, (k + 0.5) * row + 3.5);
    });
    g.fillStyle = "#c98600";
    for (const time of marks) g.fillRect(x(time) - 1, 0, 2, bottom);
  }

  drawTimeline() {
    const { series, pushes, duration } = this.content;
    const ratio = window.devicePixelRatio || 1;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    const g = this.canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.fillStyle = "rgba(29, 39, 51, .045)";
    g.fillRect(0, 0, width, height);
    const x = (time) => (time / duration) * width;
    g.font = "10px system-ui, 'DejaVu Sans', sans-serif";
    let free = 0;  // where no label has been written yet
    for (const push of pushes) {
      g.fillStyle = "rgba(213, 94, 0, .28)";
      g.fillRect(x(push.start), 0, Math.max(x(push.end) - x(push.start), 2), height - 13);
      const size = g.measureText(push.impulse).width;
      const left = width - x(push.end) > size + 8 ? x(push.end) + 4 : x(push.start) - 4 - size;
      if (left < free) continue;
      free = left + size + 4;
      g.fillStyle = "#b34f00";
      g.textAlign = "left";
      g.fillText(push.impulse, left, 11);
    }
    const bottom = height - 13;
    this.drawContacts(g, x, bottom);
    const curve = (values, top, color) => {
      g.beginPath();
      values.forEach((value, k) => g.lineTo(x(series.time[k]), bottom - 2 - (value / top) * (bottom - 16)));
      g.strokeStyle = color;
      g.lineWidth = 1.6;
      g.stroke();
    };
    // Curves below ten of their last digits are drawn small.
    for (const c of series.curves) curve(c.values, Math.max(...c.values, 10 ** (1 - c.digits)), c.color);
    g.fillStyle = "#5b6877";
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((s) => duration / s <= width / 60) || 100;
    for (let time = 0; time <= duration + 1e-9; time += step) {
      g.textAlign = time === 0 ? "left" : time > duration - 0.02 * duration ? "right" : "center";
      g.fillText(String(Number((this.content.start + time).toFixed(2))), x(time), height - 2);
    }
    g.fillStyle = "#1d2733";
    g.fillRect(x(this.time) - 1, 0, 2, bottom);
    if (width < 400) return;
    g.textAlign = "right";
    g.strokeStyle = "rgba(247, 248, 250, .9)";  // a rim: curves pass behind the words
    g.lineWidth = 4;
    g.lineJoin = "round";
    series.curves.forEach((c, row) => {
      const words = `${c.label}, up to ${Math.max(...c.values).toFixed(c.digits)}${c.unit}`;
      g.strokeText(words, width - 4, 24 + 12 * row);
      g.fillStyle = c.color;
      g.fillText(words, width - 4, 24 + 12 * row);
    });
  }
}

function describe(content) {
  const verdict = document.getElementById("verdict");
  const words = content.name.split(/(?<=_)/).flatMap((word) => [word, document.createElement("wbr")]);
  document.getElementById("name").replaceChildren(...words);
  document.getElementById("created").textContent = content.created;
  verdict.textContent = content.verdict;
  verdict.className = content.verdict;
  const add = (parent, kind, text) => {
    const element = document.createElement(kind);
    element.textContent = text;
    document.getElementById(parent).append(element);
  };
  document.getElementById("reasons").className = content.verdict;
  for (const reason of content.reasons) add("reasons", "li", reason);
  for (const [label, value] of content.facts) {
    add("facts", "dt", label);
    add("facts", "dd", value);
  }
}

function addLegend(viewer, entries) {
  const node = (path) => viewer.scene_tree.find(path.split("/").filter((part) => part)).object;
  for (const entry of entries) {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = entry.on;
    const swatch = document.createElement("i");
    swatch.style.setProperty("--swatch", entry.color);
    const text = document.createElement("span");
    text.textContent = entry.label;
    const note = document.createElement("small");
    note.textContent = entry.note || "";
    label.append(box, swatch, text, note);
    document.getElementById("legend").append(label);
    box.onchange = () => {
      if (entry.action === "see-through") seeThrough(node(entry.path), box.checked);
      else node(entry.path).visible = box.checked;
      viewer.set_dirty();
    };
    box.onchange();
  }
}

function seeThrough(root, on) {
  root.traverse((object) => {
    if (!object.material) return;
    object.material.transparent = on;
    object.material.opacity = on ? 0.3 : 1;
    object.material.depthWrite = !on;
    object.material.needsUpdate = true;
  });
}

function report(error) {
  const trouble = document.getElementById("trouble");
  trouble.textContent = error.message;
  trouble.hidden = false;
  throw error;
}
