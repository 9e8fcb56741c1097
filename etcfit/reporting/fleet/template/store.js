"use strict";
/* The fleet as the page holds it: names, columns unpacked when first asked for, which units are shown, and which is chosen. */
(function (etcfit) {
  class Store {
    constructor(data) {
      this.data = data;
      this.names = data.units;
      this.count = data.units.length;
      this.place = new Map(data.units.map((name, k) => [name, k]));
      this.shown = new Uint8Array(this.count).fill(1);
      this.odd = new Map(data.odd.map((each) => [each.unit, each]));
      this.stuck = new Set(data.stuck);
      this.chosen = this.hovered = -1;
      this.told = { filter: [], chosen: [], hovered: [] };
      this.unpacked = new Map();
    }

    on(what, call) { this.told[what].push(call); }
    tell(what) { for (const call of this.told[what]) call(); }

    /* Numbers of a packed column, unpacked once. */
    column(pack) {
      if (!this.unpacked.has(pack)) this.unpacked.set(pack, pack.i32 ? etcfit.codes(pack) : etcfit.typed(pack));
      return this.unpacked.get(pack);
    }

    /* What unit k has of batch, rig, operator, part or date; null where it has none. */
    group(name, k) {
      const group = this.data.groups[name], code = group ? this.column(group.of)[k] : -1;
      return code < 0 ? null : group.names[code];
    }

    /* Its serial, temperature or chi2_per_dof; null where it has none. */
    own(name, k) {
      const kept = this.data[name];
      if (!kept) return null;
      const value = Array.isArray(kept) ? kept[k] || null : this.column(kept)[k];
      return Number.isNaN(value) ? null : value;
    }

    choose(k) {
      if (k === this.chosen) return;
      this.chosen = k;
      this.tell("chosen");
    }

    hover(k) {
      if (k === this.hovered) return;
      this.hovered = k;
      this.tell("hovered");
    }

    /* keep(k): whether unit k is shown. */
    filter(keep) {
      for (let k = 0; k < this.count; k++) this.shown[k] = keep(k) ? 1 : 0;
      this.tell("filter");
    }

    total() { return this.shown.reduce((sum, each) => sum + each, 0); }

    /* The next unit shown after k in steps of +1 or -1, around the end; -1 where none is. */
    next(k, step) {
      for (let tried = 1; tried <= this.count; tried++) {
        const at = (((k < 0 && step < 0 ? 0 : k) + step * tried) % this.count + this.count) % this.count;
        if (this.shown[at]) return at;
      }
      return -1;
    }
  }

  etcfit.Store = Store;
})(globalThis.etcfit ??= {});
