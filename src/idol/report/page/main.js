// Puts the run's data into the page.
const data = JSON.parse(document.getElementById("run-data").textContent);
const $ = id => document.getElementById(id);
const reveal = id => { $(id).hidden = false; };
const redraws = [];

let view = null, charts = null;
const endTime = data.smoothed.t.length ? data.smoothed.t.at(-1) : 0;
function setTime(time) {
  $("time").value = time;
  $("time-text").textContent = `${time.toFixed(2)} s`;
  view?.setTime(time);
  charts?.setTime(time);
}

function fillView() {
  if (!data.smoothed.t.length && !data.lines.length) return;
  reveal("view-section");
  view = new View3D($("view"), data);
  const toggles = [["smoothed", "smoothed trajectory", data.smoothed.t.length], ["causal", "causal", data.causal.t.length],
    ["truth", "ground truth, aligned", data.truth.t.length], ["lines", "lines", data.lines.length],
    ["active", "only lines tracked now", data.lines.length && data.smoothed.t.length]];
  for (const [name, label, there] of toggles) {
    if (!there) { view.show[name] = false; continue; }
    const box = el("input", {type: "checkbox"});
    box.checked = view.show[name];
    box.addEventListener("change", () => { view.show[name] = box.checked; view.draw(); drawViewLegend(); });
    $("view-toggles").append(el("label", {}, box, label));
  }
  $("line-colour").addEventListener("change", event => { view.lineColour = event.target.value; view.draw(); });
  for (const button of document.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => view.look(button.dataset.view));
  drawViewLegend();
  redraws.push(() => view.draw(), drawViewLegend);
  fillTimeline();
}

function drawViewLegend() {
  const dark = isDark(), host = $("view-legend");
  const ramp = Array.from({length: 7}, (_, i) => timeColour(i / 6, dark)).join(",");
  host.replaceChildren();
  const entry = (on, kind, style, text) => {
    if (!on) return;
    const swatch = el("span", {class: `swatch ${kind}`});
    Object.assign(swatch.style, style);
    host.append(el("div", {}, swatch, text));
  };
  entry(view.show.smoothed, "ramp", {background: `linear-gradient(90deg, ${ramp})`}, `smoothed, 0 to ${endTime.toFixed(1)} s`);
  entry(view.show.causal, "thin", {borderColor: "var(--causal)"}, "causal");
  entry(view.show.truth, "dashed", {borderColor: "var(--truth)"}, "ground truth");
  host.append(el("div", {}, `grid ${+view.step.toPrecision(2)} m`));
}

function fillTimeline() {
  const slider = $("time"), button = $("play");
  if (!data.smoothed.t.length) { slider.closest(".timeline").hidden = true; return; }
  slider.max = endTime;
  slider.addEventListener("input", () => { stop(); setTime(Number(slider.value)); });
  let frame = null;
  const stop = () => {
    cancelAnimationFrame(frame);
    frame = null;
    button.textContent = "▶";
    button.setAttribute("aria-label", "Play");
  };
  button.addEventListener("click", () => {
    if (frame !== null) return stop();
    // Real time, but no more than 20 s for the whole run.
    const speed = Math.max(1, endTime / 20), begin = Number(slider.value) >= endTime ? 0 : Number(slider.value);
    let start = null;
    const step = now => {
      start ??= now;
      const time = begin + speed * (now - start) / 1000;
      setTime(Math.min(time, endTime));
      if (time < endTime) frame = requestAnimationFrame(step); else stop();
    };
    button.textContent = "❚❚";
    button.setAttribute("aria-label", "Pause");
    frame = requestAnimationFrame(step);
  });
}

function fillEvaluations() {
  if (!data.evaluations.length) return;
  reveal("evaluation-section");
  $("evaluations").append(...data.evaluations.map(evaluationCard));
}

function fillCurves() {
  if (!data.panels.length) return;
  reveal("curves-section");
  const notes = ["Hover to read values, click to set the time of the 3D view, drag to zoom in, double-click to zoom out."];
  if (data.matched)
    notes.push(`Ground truth is moved into the estimate's world by a shift and a yaw, least squares over all ${data.matched} matched poses; `
      + "its velocity is differentiated over ±25 ms. Errors are after this alignment, made for each trajectory by itself.");
  $("curves-note").textContent = notes.join(" ");
  charts = new TimeCharts($("curves"), data.panels, time => setTime(Math.max(0, Math.min(endTime, time))));
  redraws.push(() => charts.redraw());
}

function fillSummary() {
  const stages = Object.entries(data.stats?.stages || {}).filter(([, s]) => isNumber(s)).sort((a, b) => b[1] - a[1]);
  const place = (name, draw) => {
    reveal("summary-section");
    reveal(`${name}-figure`);
    new ResizeObserver(draw).observe($(`${name}-figure`));
    redraws.push(draw);
  };
  if (data.trackLengths) place("tracks", () => drawHistogram($("tracks"), data.trackLengths));
  if (stages.length) place("stages", () => drawBars($("stages"), stages));
}

function fillPictures() {
  if (!data.pictures.length) return;
  reveal("pictures-section");
  for (const {caption, src} of data.pictures) {
    const image = el("img", {src, alt: `Events and lines. ${caption}`, tabindex: "0", role: "button"});
    const open = () => {
      const box = $("lightbox");
      box.querySelector("img").src = src;
      box.querySelector("p").textContent = caption;
      box.showModal();
    };
    image.addEventListener("click", open);
    image.addEventListener("keydown", event => { if (event.key === "Enter") open(); });
    $("pictures").append(el("figure", {class: "card"}, image, el("figcaption", {}, caption)));
  }
  $("lightbox").addEventListener("click", () => $("lightbox").close());
}

function fillFilesAndNotes() {
  for (const {name, text} of data.files) {
    reveal("files-section");
    $("files").append(el("details", {}, el("summary", {}, name), el("pre", {}, text)));
  }
  for (const note of data.notes) {
    reveal("notes-section");
    $("notes").append(el("li", {}, note));
  }
}

// A part that meets something unforeseen must not take the rest of the page with it.
for (const [name, fill] of [["header", () => fillHeader(data)], ["3D view", fillView], ["evaluation", fillEvaluations],
  ["curves", fillCurves], ["summary", fillSummary], ["pictures", fillPictures], ["notes", fillFilesAndNotes]])
  try {
    fill();
  } catch (error) {
    reveal("notes-section");
    $("notes").append(el("li", {}, `The part "${name}" could not be drawn: ${error.message}`));
  }
if (endTime) setTime(endTime);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraws.forEach(redraw => redraw()));
