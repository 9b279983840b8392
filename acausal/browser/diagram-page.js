/* The diagram as a page: blocks open and close, the view moves.

   app.ready          a promise of the first picture
   app.open(path), app.close(path)      promises of the next picture
   app.blocks()       paths of the blocks that are shown                     */
"use strict";

const app = (() => {
  const place = document.getElementById("view"), opened = {};
  let view = null;
  for (const path of acausal.opened) opened[path] = true;
  document.querySelector("h1").textContent = document.title;

  function draw() {
    return new Promise((resolve, reject) => {
      diagramLayout(acausal.graph, opened, elkModule.exports.default, (layout) => {
        place.innerHTML = diagramSvg(layout);
        const svg = place.querySelector("svg");
        svg.removeAttribute("width");
        svg.removeAttribute("height");
        fit(layout.width, layout.height);
        resolve(app);
      }, reject);
    });
  }

  function fit(width, height) {
    // Not larger than life: a small diagram stays small.
    const room = place.getBoundingClientRect(), scale = Math.max(width / room.width, height / room.height, 0.6);
    const w = room.width * scale, h = room.height * scale;
    view = { x: (width - w) / 2, y: (height - h) / 2, w, h, width, height };
    show();
  }

  function show() {
    place.querySelector("svg").setAttribute("viewBox", [view.x, view.y, view.w, view.h].join(" "));
  }

  function toggle(path) {
    if (opened[path]) delete opened[path];
    else opened[path] = true;
    return draw();
  }

  let drag = null, moved = false;
  place.addEventListener("pointerdown", (e) => { drag = { x: e.clientX, y: e.clientY, vx: view.x, vy: view.y }; moved = false; });
  window.addEventListener("pointermove", (e) => {
    if (!drag) return;
    const scale = view.w / place.clientWidth;
    if (Math.hypot(e.clientX - drag.x, e.clientY - drag.y) > 4) moved = true;
    view.x = drag.vx - (e.clientX - drag.x) * scale;
    view.y = drag.vy - (e.clientY - drag.y) * scale;
    show();
  });
  window.addEventListener("pointerup", () => { drag = null; });
  place.addEventListener("wheel", (e) => {
    e.preventDefault();
    const factor = Math.exp(e.deltaY * 0.0015), box = place.getBoundingClientRect();
    const px = (e.clientX - box.left) / box.width, py = (e.clientY - box.top) / box.height;
    view.x += view.w * px * (1 - factor);
    view.y += view.h * py * (1 - factor);
    view.w *= factor;
    view.h *= factor;
    show();
  }, { passive: false });
  place.addEventListener("click", (e) => {
    const node = e.target.closest(".openable");
    if (node && !moved) toggle(node.dataset.path);
  });
  document.getElementById("fit").addEventListener("click", () => fit(view.width, view.height));

  const ready = draw();
  return {
    ready,
    open: (path) => { opened[path] = true; return draw(); },
    close: (path) => { delete opened[path]; return draw(); },
    blocks: () => Array.from(place.querySelectorAll("[data-path]"), (n) => n.dataset.path),
  };
})();
window.app = app;
