// The replay is a page of its own with a viewer of a megabyte: it is unpacked when it is asked for.
for (const replay of document.querySelectorAll(".replay")) {
  replay.querySelector("button").addEventListener("click", () => {
    const packed = atob(replay.querySelector("script").textContent);
    const frame = document.createElement("iframe");
    frame.title = "Replay";
    frame.srcdoc = new TextDecoder().decode(Uint8Array.from(packed, (letter) => letter.charCodeAt(0)));
    replay.replaceChildren(frame);
  });
}
// Paper shows everything.
let unfolded = [];
addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open])")];
  unfolded.forEach((each) => { each.open = true; });
});
addEventListener("afterprint", () => unfolded.forEach((each) => { each.open = false; }));
