"use strict";
// The points of this page, turned by hand. Nothing is loaded and nothing is sent.
(function () {
  const canvas = document.getElementById("view");
  const says = document.getElementById("view-says");
  const bar = document.getElementById("view-bar");
  const barSays = document.getElementById("view-bar-says");
  const fail = function (why) {
    canvas.dataset.state = "failed";
    canvas.hidden = true;
    says.textContent = "This browser shows no three-dimensional view (" + why + "). All else on this page stands without it.";
  };
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) { fail("no WebGL"); return; }

  // Twelve bytes a point: place (3 x 16 bits), deviation (16 bits), outward (3 x 8 bits), one to fill.
  const text = atob(canvas.dataset.points);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) { bytes[i] = text.charCodeAt(i); }
  const count = bytes.length / 12;
  const extent = Number(canvas.dataset.extentMm);   // mm from the middle to the end of 16 bits
  const spacing = Number(canvas.dataset.spacing);   // of the same
  const edges = canvas.dataset.edges.split(",").map(Number);
  const colours = canvas.dataset.colours.split(",").map(function (c) {
    return [1, 3, 5].map(function (at) { return parseInt(c.slice(at, at + 2), 16) / 255; });
  });

  const compile = function (kind, source) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) { throw new Error(gl.getShaderInfoLog(shader)); }
    return shader;
  };
  const program = gl.createProgram();
  try {
    gl.attachShader(program, compile(gl.VERTEX_SHADER, `
      attribute vec3 place; attribute float deviation; attribute vec3 outward;
      uniform mat3 turn; uniform vec2 fit; uniform vec2 shift; uniform float size;
      varying float band; varying float light; varying float dots;
      uniform float edges[8];
      void main() {
        vec3 at = turn * place;
        vec3 facing = length(outward) > 0.0 ? turn * normalize(outward) : vec3(0.0, 0.0, 1.0);
        gl_Position = vec4((at.xy + shift) * fit, -at.z * 0.25, 1.0);
        // What looks away is behind the part's own surface.
        if (facing.z < -0.02) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); }
        gl_PointSize = size;
        dots = size;
        light = 0.72 + 0.28 * clamp(facing.z, 0.0, 1.0);
        band = 0.0;
        for (int k = 0; k < 8; k++) { if (deviation > edges[k]) { band += 1.0; } }
      }`));
    gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `
      precision mediump float;
      varying float band; varying float light; varying float dots;
      uniform vec3 colours[9];
      void main() {
        vec3 colour = colours[0];
        for (int k = 1; k < 9; k++) { if (band > float(k) - 0.5) { colour = colours[k]; } }
        colour *= light;
        // The marks of the maps: lying strokes below, standing ones above, triangles beyond the limits.
        vec2 p = gl_PointCoord * 2.0 - 1.0;
        // A point is a disc; squares side by side would look like tiles.
        if (dots >= 4.0 && dot(p, p) > 1.0) { discard; }
        if (dots >= 8.0) {
          float away = band - 4.0;
          bool mark = false;
          if (abs(away) > 3.5) {
            float y = away > 0.0 ? p.y : -p.y;
            mark = abs(p.x) < (y + 0.7) * 0.5 && y < 0.6;
          } else if (abs(away) > 0.5 && abs(p.x) < 0.75 && abs(p.y) < 0.75) {
            float across = away > 0.0 ? p.x : p.y;
            float n = abs(away);
            for (int k = 0; k < 3; k++) {
              if (float(k) < n - 0.5) {
                float at = (float(k) - (n - 1.0) * 0.5) * 0.5;
                if (abs(across - at) < 0.1) { mark = true; }
              }
            }
          }
          if (mark) { colour = abs(away) > 2.5 ? vec3(1.0) : vec3(0.1); }
        }
        gl_FragColor = vec4(colour, 1.0);
      }`));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) { throw new Error(gl.getProgramInfoLog(program)); }
  } catch (error) { fail(String(error)); return; }
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  const attribute = function (name, size, kind, offset) {
    const at = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, kind, true, 12, offset);
  };
  attribute("place", 3, gl.SHORT, 0);
  attribute("deviation", 1, gl.SHORT, 6);
  attribute("outward", 3, gl.BYTE, 8);
  const uniform = function (name) { return gl.getUniformLocation(program, name); };
  gl.uniform1fv(uniform("edges"), edges);
  gl.uniform3fv(uniform("colours"), [].concat.apply([], colours));
  gl.enable(gl.DEPTH_TEST);

  const home = { yaw: -30, pitch: -60, zoom: 1, x: 0, y: 0 };
  const from = /turn=(-?[\d.]+),(-?[\d.]+)(?:,([\d.]+))?/.exec(location.hash);
  if (from) { home.yaw = Number(from[1]); home.pitch = Number(from[2]); home.zoom = Number(from[3] || 1) || 1; }
  let view = Object.assign({}, home);
  let asked = false, first = true;

  const draw = function () {
    asked = false;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const cy = Math.cos(view.yaw * Math.PI / 180), sy = Math.sin(view.yaw * Math.PI / 180);
    const cp = Math.cos(view.pitch * Math.PI / 180), sp = Math.sin(view.pitch * Math.PI / 180);
    // First about Z, then about the picture's X; by columns.
    gl.uniformMatrix3fv(uniform("turn"), false, [cy, cp * sy, sp * sy, -sy, cp * cy, sp * cy, 0, -sp, cp]);
    const least = Math.min(width, height);
    gl.uniform2f(uniform("fit"), 0.95 * view.zoom * least / width, 0.95 * view.zoom * least / height);
    gl.uniform2f(uniform("shift"), view.x, view.y);
    const perUnit = 0.95 * view.zoom * least / 2;   // px of the canvas for one extent
    // Points that touch where there are many. Few do not grow to tiles: they stay points, larger as they are
    // looked at from nearer, until their marks are read well.
    const most = Math.min(24, Math.max(9, 9 * Math.sqrt(view.zoom))) * ratio;
    gl.uniform1f(uniform("size"), Math.min(most, Math.max(1.5 * ratio, 2.2 * spacing * perUnit)));
    gl.drawArrays(gl.POINTS, 0, count);
    const perMm = perUnit / extent / ratio;
    const rough = 160 / perMm;
    const decade = Math.pow(10, Math.floor(Math.log10(rough)));
    const length = [5, 2, 1].map(function (m) { return m * decade; }).find(function (v) { return v <= rough; }) || decade;
    bar.style.width = (length * perMm).toFixed(1) + "px";
    barSays.textContent = (length < 1 ? Number((length * 1000).toPrecision(3)) + " \u00b5m" : Number(length.toPrecision(3)) + " mm");
    if (first) {
      first = false;
      const pixels = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      let lit = 0;
      for (let i = 0; i < pixels.length; i += 4) { if (pixels[i] + pixels[i + 1] + pixels[i + 2] < 765) { lit++; } }
      canvas.dataset.lit = (lit / (width * height)).toFixed(4);
    }
    canvas.dataset.state = "drawn";
    canvas.dataset.drawn = count;
    canvas.dataset.turn = view.yaw.toFixed(1) + "," + view.pitch.toFixed(1);
  };
  const again = function () { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const turn = function (yaw, pitch) { view.yaw += yaw; view.pitch += pitch; again(); };
  const zoom = function (by) { view.zoom = Math.min(200, Math.max(0.2, view.zoom * by)); again(); };

  let held = null;
  canvas.addEventListener("pointerdown", function (e) {
    held = [e.clientX, e.clientY];
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointerup", function () { held = null; });
  canvas.addEventListener("pointercancel", function () { held = null; });
  canvas.addEventListener("pointermove", function (e) {
    if (!held) { return; }
    const dx = e.clientX - held[0], dy = e.clientY - held[1];
    held = [e.clientX, e.clientY];
    if (e.shiftKey || e.buttons === 2) {
      const unit = 0.95 * view.zoom * Math.min(canvas.clientWidth, canvas.clientHeight) / 2;
      view.x += dx / unit; view.y -= dy / unit; again();
    } else { turn(dx * 0.4, dy * 0.4); }
  });
  canvas.addEventListener("contextmenu", function (e) { e.preventDefault(); });
  canvas.addEventListener("wheel", function (e) { e.preventDefault(); zoom(Math.exp(-e.deltaY * 0.0015)); }, { passive: false });
  canvas.addEventListener("dblclick", function () { view = Object.assign({}, home); again(); });
  canvas.addEventListener("keydown", function (e) {
    const keys = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] };
    if (keys[e.key]) { e.preventDefault(); turn(keys[e.key][0], keys[e.key][1]); }
    if (e.key === "+" || e.key === "-") { zoom(e.key === "+" ? 1.25 : 0.8); }
  });
  window.addEventListener("resize", again);
  draw();
})();
