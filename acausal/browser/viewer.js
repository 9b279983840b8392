/* A run as a moving scene: the poses are the tracks of the embedded glTF; curves and slider share its time.

   app.ready            a promise of the loaded scene
   app.seek(t)          show the time t [s] of the run; returns the time shown
   app.pose(name)       4x4 matrix of a node in the model's axes, row by row
   app.names()          the nodes
   app.play(), pause()                                                                            */
"use strict";

const app = (() => {
  const begin = acausal.start, end = acausal.stop;
  const view = document.getElementById("view");
  const slider = document.getElementById("slider"), clock = document.getElementById("clock");
  const button = document.getElementById("play"), speed = document.getElementById("speed");
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(35, 1, 1e-3, 1e3);
  let renderer = null, controls = null, mixer = null, action = null, root = null, model = null, now = begin, playing = false, last = 0;
  const plots = [], trails = [];

  function resize() {
    if (!renderer || !view.clientWidth) return;
    renderer.setSize(view.clientWidth, view.clientHeight, false);
    camera.aspect = view.clientWidth / Math.max(1, view.clientHeight);
    camera.updateProjectionMatrix();
    render();
  }

  function render() {
    if (renderer) renderer.render(scene, camera);
  }

  function light() {
    scene.background = new THREE.Color(pageColor("--back"));
    scene.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(1, 2, 1.5);
    scene.add(sun);
  }

  function startRenderer() {
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    } catch (error) {
      document.getElementById("label").textContent = "this browser has no WebGL: curves and poses only";
      return;
    }
    renderer.setPixelRatio(window.devicePixelRatio || 1);
    view.appendChild(renderer.domElement);
    controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.addEventListener("change", render);
    new ResizeObserver(resize).observe(view);
    hover();
  }

  /* The name of what is under the pointer. */
  function hover() {
    const ray = new THREE.Raycaster(), place = new THREE.Vector2();
    renderer.domElement.addEventListener("pointermove", (e) => {
      if (!root || e.buttons) return;
      const box = renderer.domElement.getBoundingClientRect();
      place.set(((e.clientX - box.left) / box.width) * 2 - 1, 1 - ((e.clientY - box.top) / box.height) * 2);
      ray.setFromCamera(place, camera);
      const hit = ray.intersectObject(root, true).find((h) => h.object.visible && h.object.isMesh);
      let node = hit && hit.object;
      while (node && node.parent !== model) node = node.parent;
      document.getElementById("label").textContent = node ? named(node) : "";
    });
  }

  function named(node) {
    return acausal.names[node.name] || node.name;
  }

  /* Forces act inside of bodies. */
  function onTop(node) {
    node.traverse((part) => {
      if (!part.isMesh) return;
      part.renderOrder = 10;
      part.material = part.material.clone();
      part.material.depthTest = false;
      part.material.transparent = true;
      part.material.opacity = 0.85;
    });
  }

  function frameAll() {
    const centre = new THREE.Vector3(...acausal.centre), reach = acausal.reach;
    const away = new THREE.Vector3(0.55, 0.4, 1).normalize().multiplyScalar(reach / Math.sin((camera.fov * Math.PI) / 360));
    camera.position.copy(centre).add(away);
    camera.near = reach / 200;
    camera.far = reach * 200;
    camera.updateProjectionMatrix();
    camera.lookAt(centre);
    if (controls) {
      controls.target.copy(centre);
      controls.update();
    }
  }

  function draw(target) {
    now = Math.min(Math.max(target, begin), end);
    if (action) {
      // Not mixer.setTime, which takes the end for the beginning of a repetition.
      action.time = Math.min(now - begin, acausal.last);
      mixer.update(0);
    }
    for (const trail of trails) {
      const count = acausal.times.findLastIndex((t) => t <= now - begin) + 1;
      trail.geometry.setDrawRange(0, Math.max(2, count));
    }
    slider.value = String(now);
    clock.textContent = now.toFixed(acausal.digits) + " s";
    for (const plot of plots) plot.setCursor({ left: plot.valToPos(now, "x"), top: -10 }, false);
    render();
    return now;
  }

  function tick(stamp) {
    if (!playing) return;
    const step = Math.min(0.1, (stamp - last) / 1000) * Number(speed.value);
    last = stamp;
    draw(now + step >= end ? begin : now + step);
    requestAnimationFrame(tick);
  }

  function play() {
    if (playing) return;
    playing = true;
    button.textContent = "❚❚";
    last = performance.now();
    requestAnimationFrame(tick);
  }

  function pause() {
    playing = false;
    button.textContent = "▶";
  }

  function curves() {
    const place = document.getElementById("curves");
    for (const panel of acausal.panels) {
      const title = document.createElement("div");
      title.className = "title";
      title.textContent = panel.title;
      place.appendChild(title);
      const data = [unpack(panel.time, 8), ...panel.signals.map((s) => Array.from(unpack(s.values), (v) => (isNaN(v) ? null : v)))];
      const series = [{ label: "t [s]", value: (u, v) => formatted(v) }, ...panel.signals.map((s, k) => ({ label: s.name, stroke: COLORS[k % COLORS.length], width: 1.5, dash: dashOver(data.slice(1), k), value: (u, v) => formatted(v), points: { show: false } }))];
      const options = {
        width: Math.max(240, place.clientWidth - 14), height: 150, pxAlign: 0, series, axes: [axisStyle(), axisStyle(panel.unit)],
        scales: { x: { time: false } }, cursor: { y: false, drag: { x: false, y: false } }, legend: { live: true },
      };
      const plot = new uPlot(options, data, place);
      plot.over.addEventListener("click", (e) => { pause(); draw(plot.posToVal(e.offsetX, "x")); });
      plots.push(plot);
    }
  }

  function pose(name) {
    if (!model) throw new Error("the scene is not loaded yet: await app.ready");
    const node = model.children.find((n) => named(n) === name || n.name === name);
    if (!node) throw new Error(`no node ${name}; there are ${app.names().join(", ")}`);
    scene.updateMatrixWorld(true);
    // In the model's axes: without the rotation that brings up to +y.
    const relative = model.matrixWorld.clone().invert().multiply(node.matrixWorld);
    const e = relative.elements;
    return [0, 1, 2, 3].map((i) => [0, 1, 2, 3].map((j) => e[4 * j + i]));
  }

  function show(kind, visible) {
    for (const node of model.children) if (node.userData.kind === kind) node.visible = visible;
    render();
  }

  const ready = new Promise((resolve, reject) => {
    const raw = Uint8Array.from(atob(acausal.glb), (c) => c.charCodeAt(0));
    new THREE.GLTFLoader().parse(raw.buffer, "", (gltf) => {
      root = gltf.scene;
      model = root.children[0];
      scene.add(root);
      if (gltf.animations.length) {
        mixer = new THREE.AnimationMixer(root);
        action = mixer.clipAction(gltf.animations[0]).play();
      }
      for (const node of model.children) if (node.userData.kind === "force") onTop(node);
      for (const node of model.children) if (node.userData.kind === "trail") trails.push(node.isLine ? node : node.children[0]);
      frameAll();
      const wanted = new URLSearchParams(location.search).get("t") ?? new URLSearchParams(location.hash.slice(1)).get("t");
      draw(wanted === null ? begin : Number(wanted));
      resolve(app);
    }, reject);
  });

  slider.min = begin;
  slider.max = end;
  slider.step = (end - begin) / 2000;
  slider.addEventListener("input", () => { pause(); draw(Number(slider.value)); });
  button.addEventListener("click", () => (playing ? pause() : play()));
  document.addEventListener("keydown", (e) => { if (e.key === " ") { e.preventDefault(); playing ? pause() : play(); } });
  for (const kind of ["trail", "force"]) {
    document.getElementById(kind).addEventListener("change", (e) => show(kind, e.target.checked));
  }
  light();
  startRenderer();
  curves();
  resize();

  return {
    ready, play, pause, pose, seek: draw,
    get time() { return now; },
    get hasPicture() { return renderer !== null; },
    names: () => model.children.map(named),
  };
})();
window.app = app;
