(times) => {
  const { viewer, seek } = lgmpc, scene = viewer.renderer.domElement, text = (id) => document.getElementById(id);
  const light = viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.shadow;
  if (light.mapSize.x > 1024) { light.mapSize.set(1024, 1024); light.map?.dispose(); light.map = null; }
  const film = document.createElement("canvas");
  Object.assign(film, { width: scene.width, height: scene.height });
  const pen = film.getContext("2d");
  return times.map((time) => {
    seek(time);
    viewer.render();
    pen.drawImage(scene, 0, 0);
    pen.font = "20px system-ui, 'DejaVu Sans', sans-serif";
    pen.fillStyle = "#1d2733";
    const now = `${text("now").textContent} s`, readout = text("readout").textContent.split("\n");
    const lines = [text("name").textContent, now, ...readout];
    lines.forEach((line, k) => pen.fillText(line, 24, 38 + 27 * k));
    if (text("badge").classList.contains("on")) {
      pen.fillStyle = "#b34f00";
      pen.fillText(text("badge").textContent, 24, 38 + 27 * lines.length);
    }
    return film.toDataURL("image/jpeg", 0.95).split(",")[1];
  });
}
