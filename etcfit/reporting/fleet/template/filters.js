"use strict";
/* Which units are shown: by batch, rig, operator, dates, name, and whether odd. */
(function (etcfit) {
  const { element } = etcfit;
  const SOME = 2;

  class Filters {
    constructor(store) {
      this.store = store;
      this.find = document.getElementById("find");
      this.odd = document.getElementById("odd-only");
      this.choices = {};
      this.dates = [];
      for (const name of ["batch", "rig", "operator"]) this.choice(name);
      this.range();
      const update = etcfit.once_a_frame(() => this.update());
      for (const each of [this.find, this.odd, ...Object.values(this.choices), ...this.dates]) {
        each.addEventListener("input", update);
        each.addEventListener("change", update);
      }
      this.find.addEventListener("keydown", (event) => { if (event.key === "Enter") this.found(); });
      document.getElementById("all").addEventListener("click", () => this.clear());
      this.count();
    }

    choice(name) {
      const group = this.store.data.groups[name];
      if (!group || group.names.length < SOME) return;
      const select = element("select", { id: `by-${name}` }, new Option("all", ""), ...group.names.map((each, code) => new Option(each, String(code))));
      this.choices[name] = select;
      document.getElementById("fields").append(element("label", {}, `${name[0].toUpperCase()}${name.slice(1)} `, select));
    }

    range() {
      const group = this.store.data.groups.date;
      if (!group || group.names.length < SOME) return;
      const ends = { min: group.names[0].slice(0, 10), max: group.names[group.names.length - 1].slice(0, 10) };
      this.dates = ["From", "To"].map((word) => {
        const input = element("input", { type: "date", id: `date-${word.toLowerCase()}`, ...ends });
        document.getElementById("fields").append(element("label", {}, `${word} `, input));
        return input;
      });
    }

    keeps() {
      const { store } = this, word = this.find.value.trim().toLowerCase(), odd = this.odd.checked;
      const codes = Object.entries(this.choices).filter(([, { value }]) => value !== "")
        .map(([name, { value }]) => [store.column(store.data.groups[name].of), Number(value)]);
      const [from = "", to = ""] = this.dates.map((each) => each.value);
      const serial = Array.isArray(store.data.serial) ? store.data.serial : null;
      return (k) => {
        if (odd && !store.odd.has(k)) return false;
        for (const [of, code] of codes) if (of[k] !== code) return false;
        if (from || to) {
          const day = store.group("date", k)?.slice(0, 10);
          if (!day || (from && day < from) || (to && day > to)) return false;
        }
        return !word || store.names[k].toLowerCase().includes(word) || Boolean(serial?.[k].toLowerCase().includes(word));
      };
    }

    update() {
      this.store.filter(this.keeps());
      this.count();
    }

    count() {
      const shown = this.store.total(), of = this.store.count;
      document.getElementById("tally").textContent =
        `${shown.toLocaleString("en")} of ${of.toLocaleString("en")} shown${shown ? "" : ": no unit is like this"}`;
    }

    found() {
      this.update();
      const k = this.store.next(-1, 1);
      if (k >= 0) this.store.choose(k);
    }

    clear() {
      this.find.value = "";
      this.odd.checked = false;
      for (const each of [...Object.values(this.choices), ...this.dates]) each.value = "";
      this.update();
    }
  }

  etcfit.once_a_frame = function (call) {
    let asked = false;
    return () => {
      if (asked) return;
      asked = true;
      requestAnimationFrame(() => { asked = false; call(); });
    };
  };

  etcfit.Filters = Filters;
})(globalThis.etcfit ??= {});
