"use strict";
/* The unit that is chosen: what is known of it, its parameters beside the population, its figures and effects. */
(function (etcfit) {
  const { element, short, symbol, unit } = etcfit;
  const FAR = 3; // standard deviations from the mean, from which on a value is marked

  class Card {
    constructor(store) {
      this.store = store;
      this.root = document.getElementById("card");
      this.title = document.getElementById("card-title");
      this.body = document.getElementById("card-body");
      this.empty = [...this.body.childNodes];
      this.root.classList.add("empty");
      document.getElementById("before").addEventListener("click", () => this.move(-1));
      document.getElementById("after").addEventListener("click", () => this.move(1));
      document.getElementById("none").addEventListener("click", () => store.choose(-1));
      store.on("chosen", () => this.draw());
      document.addEventListener("click", (event) => {
        const name = event.target.closest?.("[data-unit]")?.dataset.unit;
        if (name !== undefined && store.place.has(name)) store.choose(store.place.get(name));
      });
    }

    move(step) {
      const k = this.store.next(this.store.chosen, step);
      if (k >= 0) this.store.choose(k);
    }

    draw() {
      const k = this.store.chosen;
      this.root.classList.toggle("empty", k < 0);
      this.title.textContent = k < 0 ? "No unit chosen" : this.store.names[k];
      this.body.replaceChildren(...(k < 0 ? this.empty : [...this.what(k), ...this.tables(k)]));
      this.root.scrollTop = 0;
    }

    what(k) {
      const { store } = this, odd = store.odd.get(k), page = store.data.pages[k], parts = [];
      if (odd) parts.push(element("p", { class: "bad" }, `Odd: ${odd.why}`));
      if (store.stuck.has(k)) parts.push(element("p", { class: "bad" }, "Its fit did not converge."));
      if (page) parts.push(element("p", {}, element("a", { href: page.split("/").map(encodeURIComponent).join("/") }, "Its own report")));
      return parts;
    }

    tables(k) {
      const { store } = this, { data } = store, known = [];
      const add = (words, value) => { if (value !== null) known.push([[words], value]); };
      add("serial", store.own("serial", k));
      for (const name of ["date", "batch", "rig", "operator", "part"]) add(name, store.group(name, k));
      const celsius = store.own("temperature", k);
      add("temperature", celsius === null ? null : `${short(celsius)} °C`);
      const chi2 = store.own("chi2_per_dof", k);
      add("χ²/dof", chi2 === null ? null : short(chi2));
      for (const each of data.figures) {
        const value = store.column(each.value)[k];
        if (!Number.isNaN(value)) known.push([[etcfit.words(each.name)], `${short(value)} ${unit(each.unit)}`]);
      }
      for (const each of data.effects) {
        const at = store.column(each.at).indexOf(k);
        if (at >= 0) known.push([[etcfit.words(each.name)], `${short(store.column(each.strength)[at])} ${unit(each.unit ?? "")}`]);
      }
      const rows = known.map(([words, value]) => element("tr", {}, element("th", { scope: "row" }, ...words), element("td", {}, value)));
      return [this.values(k), element("table", {}, ...rows)];
    }

    values(k) {
      const { store } = this, head = ["", "value", "95 % interval", "sd off"].map((each) => element("th", { scope: "col" }, each));
      const rows = store.data.symbols.filter((each) => !Number.isNaN(store.column(each.value)[k])).map((each) => {
        const value = store.column(each.value)[k], [low, high] = [each.low, each.high].map((pack) => store.column(pack)[k]);
        const z = each.sd ? (store.column(each.shrunk_value)[k] - each.mean) / each.sd : NaN;
        const cell = element("td", Math.abs(z) >= FAR ? { class: "far" } : {}, Number.isNaN(z) ? "–" : `${z < 0 ? "−" : "+"}${Math.abs(z).toFixed(1)}`);
        const p = etcfit.power(value), of = 10 ** p;
        const span = Number.isNaN(low) ? (each.status[k] ?? "–") : `${short(low / of)} … ${short(high / of)}`;
        return element("tr", {}, element("th", { scope: "row" }, ...symbol(each.symbol), element("br"), etcfit.behind(p, each.unit)),
          element("td", {}, short(value / of, 4)), element("td", {}, span), cell);
      });
      return element("table", { class: "values" }, element("tr", {}, ...head), ...rows);
    }
  }

  etcfit.Card = Card;
})(globalThis.etcfit ??= {});
