"use strict";
/* The page: data read, sections made one after the other once something is on the screen. */
(function (etcfit) {
  const { Panel } = etcfit;

  etcfit.theme(document.getElementById("theme"), () => { for (const each of Panel.every) each.remake(); });

  function start() {
    const store = new etcfit.Store(JSON.parse(document.getElementById("data").textContent));
    const page = { store, card: new etcfit.Card(store), filters: new etcfit.Filters(store) };
    etcfit.page = page;
    page.sections = [new etcfit.Population(store), new etcfit.Pair(store), new etcfit.Charts(store), new etcfit.Effects(store),
                     new etcfit.Figures(store)];
    const rows = [...document.querySelectorAll("[data-row]")].map((row) => [row, store.place.get(row.dataset.row)]);
    store.on("filter", () => {
      for (const each of Panel.every) each.again();
      for (const [row, k] of rows) row.hidden = !store.shown[k];
    });
    store.on("chosen", () => {
      for (const each of Panel.every) each.mark();
      for (const [row, k] of rows) row.classList.toggle("chosen", k === store.chosen);
    });
    store.on("hovered", () => { for (const each of Panel.every) if (each.seen) each.mark(); });
    document.addEventListener("click", (event) => {
      const button = event.target.closest?.("[data-zoom]");
      if (button) page.sections.find((each) => each.host?.id === button.dataset.of)?.zoom(button.dataset.zoom);
    });
    new ResizeObserver(etcfit.once_a_frame(() => { for (const each of Panel.every) each.fit(); })).observe(document.getElementById("sections"));
    performance.mark("ready");
  }

  requestAnimationFrame(() => setTimeout(start)); // words and tables first
})(globalThis.etcfit ??= {});
