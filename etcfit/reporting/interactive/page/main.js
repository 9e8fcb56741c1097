"use strict";
/* The page: data read, views made, one of them told of what another one changed. */
(function (etcfit) {
  const data = JSON.parse(document.getElementById("data").textContent);
  let view, loop, list, sliders;

  function repaint() {
    if (!view) return;
    view.key();
    view.draw();
    view.update();
    loop.redraw();
  }

  /* Values of the parameters now, ties included; null where they are the fitted ones. */
  function values() {
    if (!sliders || sliders.untouched) return null;
    const now = { ...data.plant.values, ...sliders.values };
    for (const [symbol, other] of Object.entries(data.plant.ties)) now[symbol] = now[other];
    return now;
  }

  etcfit.theme(document.getElementById("theme"), repaint);

  const update = etcfit.onceAFrame(() => { view.update(); loop.update(); });
  sliders = new etcfit.Sliders(document.getElementById("sliders"), data.plant.sliders, update);
  document.getElementById("fitted").addEventListener("click", () => sliders.back());
  view = new etcfit.TraceView(data, values);
  loop = new etcfit.LoopView(data, values);
  list = new etcfit.TraceList(data.traces, (k) => view.show(k));
  list.select_worst();
  performance.mark("first-trace");
  requestAnimationFrame(() => setTimeout(() => loop.redraw())); // the trace first, then the loop below it
  etcfit.page = { data, view, loop, list, sliders };
})(globalThis.etcfit ??= {});
