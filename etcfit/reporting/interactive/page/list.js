"use strict";
/* The list of traces: filtered by test, the worst first or in the order of the files. */
(function (etcfit) {
  const { element, short } = etcfit;

  etcfit.LIGHTS = {
    green: { sign: "✓", count: "fit", rank: 0 },
    yellow: { sign: "△", count: "nearly", rank: 1 },
    red: { sign: "✕", count: "far off", rank: 2 },
  };
  const badness = (trace) => trace.off ?? Infinity; // none where the model could not be simulated
  const worse = (a, b) => etcfit.LIGHTS[b.light].rank - etcfit.LIGHTS[a.light].rank || badness(b) - badness(a);

  class TraceList {
    /* traces: of the page's data; choose(k): called with the number of the one that is wanted. */
    constructor(traces, choose) {
      this.traces = traces;
      this.choose = choose;
      this.worst = true;
      this.test = "";
      this.chosen = -1;
      this.list = document.getElementById("list");
      const filter = document.getElementById("filter"), tests = [...new Set(traces.map((each) => each.test))];
      filter.append(new Option("all tests", ""), ...tests.map((test) => new Option(etcfit.words(test), test)));
      filter.addEventListener("change", () => { this.test = filter.value; this.draw(); });
      const worst = document.getElementById("worst");
      worst.addEventListener("click", () => {
        this.worst = !this.worst;
        worst.setAttribute("aria-pressed", String(this.worst));
        this.draw();
        this.list.scrollTop = 0;
      });
      this.list.addEventListener("keydown", (event) => this.key_pressed(event));
      this.draw();
    }

    draw() {
      const shown = this.traces.map((trace, k) => ({ trace, k })).filter(({ trace }) => !this.test || trace.test === this.test);
      if (this.worst) shown.sort((a, b) => worse(a.trace, b.trace));
      this.list.replaceChildren(...shown.map(({ trace, k }) => element("li", {}, this.button(trace, k))));
      const count = (light) => shown.filter(({ trace }) => trace.light === light).length;
      document.getElementById("tally").textContent =
        `${shown.length} traces: ${Object.entries(etcfit.LIGHTS).map(([light, each]) => `${each.sign} ${count(light)} ${each.count}`).join(", ")}`;
      this.mark();
    }

    button(trace, k) {
      const { sign } = etcfit.LIGHTS[trace.light];
      const button = element("button", { type: "button", "data-trace": String(k) },
        element("span", { class: `sign ${trace.light}`, "aria-hidden": "true" }, sign),
        element("span", { class: "name" }, trace.file),
        element("span", { class: "figure" }, `${short(trace.off)} σ`));
      button.setAttribute("aria-label", `${trace.file}, ${trace.word}, off by ${short(trace.off)} times the noise${trace.held_out ? ", held out" : ""}`);
      button.addEventListener("click", () => this.select(k));
      return button;
    }

    /* The one at the top where the worst stand first. */
    select_worst() {
      const order = this.traces.map((_, k) => k).sort((a, b) => worse(this.traces[a], this.traces[b]));
      if (order.length) this.select(order[0]);
    }

    select(k) {
      this.chosen = k;
      this.mark();
      this.choose(k);
    }

    /* One of the list takes part in the tab order, the chosen one; arrows move among the others. */
    mark() {
      const buttons = [...this.list.querySelectorAll("button")];
      const current = buttons.find((each) => Number(each.dataset.trace) === this.chosen);
      for (const each of buttons) {
        each.setAttribute("aria-current", String(each === current));
        each.tabIndex = each === (current ?? buttons[0]) ? 0 : -1;
      }
    }

    key_pressed(event) {
      const buttons = [...this.list.querySelectorAll("button")], here = buttons.indexOf(document.activeElement);
      const to = { ArrowDown: here + 1, ArrowUp: here - 1, Home: 0, End: buttons.length - 1 }[event.key];
      if (to === undefined || !buttons[to]) return;
      event.preventDefault();
      buttons[to].focus();
      this.select(Number(buttons[to].dataset.trace));
    }
  }

  etcfit.TraceList = TraceList;
})(globalThis.etcfit ??= {});
