// Keys that are held, gamepads, and sticks on the page: viser's client reports none of them.
// All is sent as the value of a hidden text of the page ("$target"), through the connection that the page has.
window.lgmpcPad ||= (() => {
  const KEYS = { i: [1, 0, 0], k: [-1, 0, 0], j: [0, 1, 0], l: [0, -1, 0], u: [0, 0, 1], o: [0, 0, -1] };
  const BUTTONS = { 0: "arm", 1: "stop", 2: "lie" }; // A, B, X of a standard gamepad
  const REST = 0.12, ALIVE_MS = 100, POLL_MS = 20;
  const state = { hold: true, speed: 0.35 }; // survives the controls, which a closed tab removes
  const held = new Set(), sticks = { move: [0, 0], turn: [0, 0] };
  let count = 0, sent = [0, 0, 0], sentAt = 0, down = {};

  function send(content) {
    count += 1;
    const value = JSON.stringify({ count, ...content }); // the count makes each value another one
    window.__viserMutable?.sendMessage?.({ type: "GuiUpdateMessage", uuid: "$target", updates: { value } });
  }
  const order = (name) => {
    release();
    send({ order: name });
  };
  function release() {
    held.clear();
    for (const each of Object.values(sticks)) each.fill(0);
    draw();
  }
  const typing = (event) => event.target.closest?.("input:not([type=range],[type=checkbox]), textarea, [contenteditable]");

  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") {
      event.preventDefault(); // it would press the button that has the focus
      event.stopPropagation();
      if (!event.repeat) order("stop");
      return;
    }
    const key = event.key.toLowerCase();
    if (!(key in KEYS) || event.repeat || typing(event)) return;
    if (state.hold) held.add(key);
    else send({ step: KEYS[key] });
  }, true);
  window.addEventListener("keyup", (event) => held.delete(event.key.toLowerCase()), true);
  window.addEventListener("blur", release); // the releases of keys go elsewhere
  document.addEventListener("visibilitychange", release);

  // Sticks: the pointer's way from the middle, over the radius.
  let grabbed = null;
  const deflect = (event) => {
    const box = grabbed.getBoundingClientRect(), radius = box.width / 2;
    const x = (event.clientX - box.left - radius) / radius, y = (event.clientY - box.top - radius) / radius;
    const scale = 1 / Math.max(1, Math.hypot(x, y));
    sticks[grabbed.dataset.axes] = [x * scale, y * scale];
    draw();
  };
  const letGo = () => {
    if (grabbed) sticks[grabbed.dataset.axes].fill(0);
    grabbed = null;
    draw();
  };
  document.addEventListener("pointerdown", (event) => {
    grabbed = event.target.closest?.(".lgmpc-stick") ?? null;
    if (grabbed) deflect(event);
  });
  document.addEventListener("pointermove", (event) => grabbed && deflect(event));
  for (const name of ["pointerup", "pointercancel"]) document.addEventListener(name, letGo);
  function draw() {
    for (const stick of document.querySelectorAll(".lgmpc-stick")) {
      const [x, y] = sticks[stick.dataset.axes];
      stick.firstElementChild.style.transform = `translate($${2 * x}em, $${stick.dataset.axes === "turn" ? 0 : 2 * y}em)`;
    }
  }

  function gamepad() {
    const found = document.hidden ? null : [...navigator.getGamepads()].find((each) => each?.connected);
    if (!found) return [0, 0, 0];
    found.buttons.forEach((button, i) => {
      if (button.pressed && !down[i] && i in BUTTONS) order(BUTTONS[i]);
      down[i] = button.pressed;
    });
    const axis = (i) => (Math.abs(found.axes[i] ?? 0) > REST ? -found.axes[i] : 0);
    return [axis(1), axis(0), axis(2)];
  }
  setInterval(() => {
    const move = gamepad();
    for (const key of held) KEYS[key].forEach((value, i) => (move[i] += value));
    const pushed = [-sticks.move[1], -sticks.move[0], -sticks.turn[0]];
    const wanted = move.map((value, i) => {
      const share = Math.max(-1, Math.min(1, value + pushed[i])) * state.speed;
      return Math.round(100 * share) / 100 + 0; // no negative zero
    });
    const now = performance.now(), moves = wanted.some((value) => value !== 0);
    if (String(wanted) === String(sent) && !(moves && now - sentAt > ALIVE_MS)) return;
    [sent, sentAt] = [wanted, now];
    send({ move: wanted });
  }, POLL_MS);

  return {
    // Gives controls that have been drawn anew their values, and hears of their changes.
    show(root) {
      const hold = root.querySelector("[name=hold]"), speed = root.querySelector("[name=speed]");
      const told = () => (root.querySelector("output").textContent = `$${Math.round(100 * state.speed)} %`);
      hold.checked = state.hold;
      hold.onchange = () => ((state.hold = hold.checked), release(), hold.blur());
      speed.value = state.speed;
      speed.oninput = () => ((state.speed = Number(speed.value)), told());
      speed.onchange = () => speed.blur();
      told();
    },
  };
})()
