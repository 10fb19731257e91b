
// Charts of points: pointing at one, or reaching it by the keyboard, reads its numbers.
(() => {
  for (const figure of document.querySelectorAll("figure.scatter")) {
    const readout = figure.querySelector(".readout");
    const invitation = readout.textContent;
    const points = Array.from(figure.querySelectorAll("[data-point]"));
    const shown = () => points.filter((point) => !point.classList.contains("hidden"));
    let current = null;

    const read = (point) => {
      current?.classList.remove("current");
      current = point;
      current?.classList.add("current");
      readout.textContent = point ? point.dataset.point : invitation;
    };
    // One stop of the Tab key for all points: the arrow keys go from one to the next.
    const makeStop = (stop) => {
      for (const point of points) point.setAttribute("tabindex", point === stop ? "0" : "-1");
    };
    for (const point of points) {
      point.addEventListener("pointerenter", () => read(point));
      point.addEventListener("pointerleave", () => {
        const focused = document.activeElement;
        read(points.includes(focused) ? focused : null);
      });
      point.addEventListener("focus", () => { makeStop(point); read(point); });
      point.addEventListener("blur", () => read(null));
      point.addEventListener("keydown", (event) => {
        const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
        const step = steps[event.key];
        if (!step) return;
        event.preventDefault();
        const all = shown();
        all[(all.indexOf(point) + step + all.length) % all.length].focus();
      });
    }
    makeStop(points[0]);

    for (const box of figure.querySelectorAll(".families input")) {
      const show = () => {
        const members = figure.querySelectorAll(`g[data-family="${box.dataset.family}"]`);
        for (const member of members) member.classList.toggle("hidden", !box.checked);
        if (current && current.classList.contains("hidden")) read(null);
        makeStop(shown()[0]);
      };
      box.addEventListener("change", show);
      // A browser may keep an unchecked box over a reload.
      show();
    }
  }
})();
