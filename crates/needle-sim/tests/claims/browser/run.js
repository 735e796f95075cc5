// What a run's page shows before and after a press on the slider's rail.
const pressRail = (figure, fraction) => {
  const rail = figure.querySelector(".slider-rail-touch-rect");
  const box = rail.getBoundingClientRect();
  const at = { clientX: box.left + fraction * box.width, clientY: box.top + box.height / 2 };
  for (const kind of ["mousedown", "mouseup"]) {
    rail.dispatchEvent(new MouseEvent(kind, { bubbles: true, ...at }));
  }
};
const state = (scene) => {
  const at = (name) => scene.data.find((trace) => trace.name === name);
  const last = (trace) => [trace.x, trace.y, trace.z].map((values) => values[values.length - 1]);
  const sliders = scene.layout.sliders;
  return {
    active: sliders ? sliders[0].active : null,
    shaft: at("shaft") ? last(at("shaft")) : null,
    horizon: at("predicted horizon") ? at("predicted horizon").x.length : null,
    terminal: at("terminal set") ? at("terminal set").x.length : null,
    cursor_s: document.getElementById("signals").layout.shapes[0].x0,
  };
};
const examine = async () => {
  const scene = document.getElementById("scene");
  await settled(() => scene.querySelector("canvas"));
  const found = {
    traces: scene.data.map((trace) => trace.name),
    signals: document.getElementById("signals").data.map((trace) => trace.name),
    drawn: scene.querySelectorAll("canvas").length,
    frames: scene.layout.sliders ? scene.layout.sliders[0].steps.length : 0,
    aspect: scene._fullLayout.scene.aspectratio,
    ranges: ["xaxis", "yaxis", "zaxis"].map((axis) => scene._fullLayout.scene[axis].range),
    overflow: document.documentElement.scrollWidth > innerWidth,
    before: state(scene),
  };
  if (scene.layout.sliders) {
    pressRail(scene, 1);
    await settled(() => {
      const [{ cursor_s, shaft }, before] = [state(scene), found.before];
      return cursor_s !== before.cursor_s && String(shaft) !== String(before.shaft);
    });
  }
  return { ...found, after: state(scene) };
};
