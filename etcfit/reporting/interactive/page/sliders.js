"use strict";
/* Sliders for numbers: geometric where a value is positive, straight where it may be zero or of either sign. */
(function (etcfit) {
  const { element, short } = etcfit;
  const FINE = 1000; // places of a slider

  class Sliders {
    /* host: an element; rows: [{symbol, unit, meaning, value, low, high, geometric}]; moved(values): after a change. */
    constructor(host, rows, moved) {
      this.rows = rows;
      this.moved = moved;
      this.values = Object.fromEntries(rows.map((row) => [row.symbol, row.value]));
      this.inputs = new Map(rows.map((row) => [row.symbol, this.build(row)]));
      host.replaceChildren(...[...this.inputs.values()].map(({ box }) => box));
      for (const row of rows) this.write(row);
    }

    build(row) {
      const id = `slider-${row.symbol}`, input = element("input", { type: "range", id, min: "0", max: String(FINE), step: "1" });
      const output = element("output", { for: id });
      const label = element("label", { for: id }, ...etcfit.symbol(row.symbol));
      const note = row.status && row.status !== "estimated" ? `${row.meaning} (${row.status})` : row.meaning;
      const box = element("div", { class: "slider" }, label, output, input, element("span", { class: "meaning" }, note));
      input.addEventListener("input", () => {
        this.values[row.symbol] = Number(input.value) === this.place(row, row.value) ? row.value : this.value(row, Number(input.value));
        this.write(row, false);
        this.moved(this.values);
      });
      input.addEventListener("dblclick", () => this.back([row]));
      return { box, input, output };
    }

    place(row, value) {
      const share = row.geometric ? Math.log(value / row.low) / Math.log(row.high / row.low) : (value - row.low) / (row.high - row.low);
      return Math.round(FINE * Math.min(Math.max(share, 0), 1));
    }

    value(row, place) {
      const share = place / FINE;
      return row.geometric ? row.low * (row.high / row.low) ** share : row.low + share * (row.high - row.low);
    }

    write(row, place = true) {
      const { box, input, output } = this.inputs.get(row.symbol), value = this.values[row.symbol];
      const text = `${short(value, 4)} ${etcfit.unit(row.unit)}`;
      if (place) input.value = String(this.place(row, value));
      output.textContent = text;
      input.setAttribute("aria-valuetext", text);
      box.classList.toggle("moved", value !== row.value);
    }

    get untouched() { return this.rows.every((row) => this.values[row.symbol] === row.value); }

    back(rows = this.rows) {
      for (const row of rows) {
        this.values[row.symbol] = row.value;
        this.write(row);
      }
      this.moved(this.values);
    }
  }

  etcfit.Sliders = Sliders;

  /* Work that is done once a frame at most, however often it is asked for. */
  etcfit.onceAFrame = function (work) {
    let waiting = false;
    return () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => { waiting = false; work(); });
    };
  };
})(globalThis.etcfit ??= {});
