// What both pages draw a scene with: WebGL, and nothing else. `sceneOn` gives `draw`, or null.
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
const floats = text => new Float32Array(bytes(text));

// ---- matrices: columns first, as WebGL has them ---------------------------------------------
function fromPose(p, q, s) {
  const [w, x, y, z] = q, [a, b, c] = s;
  return [a * (1 - 2 * (y * y + z * z)), a * 2 * (x * y + w * z), a * 2 * (x * z - w * y), 0,
    b * 2 * (x * y - w * z), b * (1 - 2 * (x * x + z * z)), b * 2 * (y * z + w * x), 0,
    c * 2 * (x * z + w * y), c * 2 * (y * z - w * x), c * (1 - 2 * (x * x + y * y)), 0,
    p[0], p[1], p[2], 1];
}
function times(a, b) {
  const c = new Array(16).fill(0);
  for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) {
    c[4 * i + j] += a[4 * k + j] * b[4 * i + k];
  }
  return c;
}
const minus = (a, b) => a.map((x, i) => x - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => a.map(x => x / (Math.hypot(...a) || 1));
function lookAt(eye, at) {
  const z = unit(minus(eye, at)), x = unit(cross([0, 0, 1], z)), y = cross(z, x);
  return [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
    -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
}
function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1,
    0, 0, 2 * far * near / (near - far), 0];
}

// ---- shapes: triangles with normals ---------------------------------------------------------
function flat(vertices, faces) {
  const out = [];
  for (let i = 0; i < faces.length; i += 3) {
    const corner = [0, 1, 2].map(k => [0, 1, 2].map(d => vertices[3 * faces[i + k] + d]));
    const normal = unit(cross(minus(corner[1], corner[0]), minus(corner[2], corner[0])));
    for (const point of corner) out.push(...point, ...normal);
  }
  return new Float32Array(out);
}
function grid(point, normal, n, m) {
  const out = [];
  for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) {
    for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) {
      const u = (i + a) / n, v = (j + b) / m;
      out.push(...point(u, v), ...unit(normal(u, v)));
    }
  }
  return out;
}
const TURN = 2 * Math.PI;
const ball = (u, v, lift = 0) => {
  const t = Math.PI * v;
  return [Math.sin(t) * Math.cos(TURN * u), Math.sin(t) * Math.sin(TURN * u), Math.cos(t) + lift];
};
function cylinder(capped) {
  const side = grid((u, v) => [Math.cos(TURN * u), Math.sin(TURN * u), 2 * v - 1],
    u => [Math.cos(TURN * u), Math.sin(TURN * u), 0], 24, 1);
  if (!capped) return side;
  for (const z of [-1, 1]) {
    side.push(...grid((u, v) => [v * Math.cos(TURN * u), v * Math.sin(TURN * u), z], () => [0, 0, z], 24, 1));
  }
  return side;
}
const CUBE = [];
for (let k = 0; k < 8; k++) CUBE.push(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
const FACES = [0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5];
const shapes = {
  box: () => flat(CUBE, FACES),
  sphere: () => new Float32Array(grid(ball, ball, 24, 12)),
  cylinder: () => new Float32Array(cylinder(true)),
  tube: () => new Float32Array(cylinder(false)),
  plane: () => flat([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], [0, 1, 2, 0, 2, 3]),
};

// ---- drawing --------------------------------------------------------------------------------
function compiled(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}
function sceneOn(canvas, meshes, middle, redraw) {
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) return null;
  const buffers = new Map();
  const program = compiled(gl,
    "attribute vec3 p, n; uniform mat4 m, v; varying vec3 d; void main() {" +
    "d = mat3(m[0].xyz, m[1].xyz, m[2].xyz) * n; gl_Position = v * m * vec4(p, 1.0); }",
    "precision mediump float; varying vec3 d; uniform vec4 c; void main() {" +
    "vec3 u = normalize(d); float l = 0.45 + 0.4 * max(0.0, dot(u, vec3(0.4, -0.5, 0.77)))" +
    " + 0.15 * u.z; gl_FragColor = vec4(c.rgb * l, c.a); }");
  const line = compiled(gl,
    "attribute vec3 p; uniform mat4 v; void main() { gl_Position = v * vec4(p, 1.0); }",
    "precision mediump float; uniform vec4 c; void main() { gl_FragColor = c; }");
  const eye = { at: middle, far: 2.5, turn: -0.9, tilt: 0.45 };
  function bufferOf(name) {
    if (!buffers.has(name)) {
      const mesh = meshes[name];
      const made = mesh ? flat(floats(mesh.vertices), new Uint32Array(bytes(mesh.faces)))
        : shapes[name]();
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, made, gl.STATIC_DRAW);
      buffers.set(name, { buffer, count: made.length / 6 });
    }
    return buffers.get(name);
  }
  function view() {
    const c = Math.cos(eye.tilt);
    const away = [c * Math.cos(eye.turn), c * Math.sin(eye.turn), Math.sin(eye.tilt)];
    const from = eye.at.map((x, i) => x + eye.far * away[i]);
    const wide = canvas.width / Math.max(1, canvas.height);
    return times(perspective(0.8, wide, 0.02, 60), lookAt(from, eye.at));
  }
  // Shapes of a generation, poses of its bodies (seven numbers each), trails as [colour, points].
  function draw(drawn, poses, trails) {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.87, 0.90, 0.93, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const seen = view();
    gl.useProgram(program);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "v"), false, seen);
    const p = gl.getAttribLocation(program, "p"), n = gl.getAttribLocation(program, "n");
    gl.enableVertexAttribArray(p);
    gl.enableVertexAttribArray(n);
    for (const shape of drawn) {
      const pose = poses.subarray(7 * shape.body, 7 * shape.body + 7);
      const body = fromPose(pose.subarray(0, 3), pose.subarray(3, 7), [1, 1, 1]);
      const { buffer, count } = bufferOf(shape.name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.vertexAttribPointer(p, 3, gl.FLOAT, false, 24, 0);
      gl.vertexAttribPointer(n, 3, gl.FLOAT, false, 24, 12);
      gl.uniformMatrix4fv(gl.getUniformLocation(program, "m"), false,
        times(body, fromPose(shape.position, shape.quaternion, shape.scale)));
      gl.uniform4fv(gl.getUniformLocation(program, "c"), shape.color);
      gl.drawArrays(gl.TRIANGLES, 0, count);
    }
    gl.disableVertexAttribArray(n);
    gl.useProgram(line);
    gl.uniformMatrix4fv(gl.getUniformLocation(line, "v"), false, seen);
    const q = gl.getAttribLocation(line, "p");
    gl.enableVertexAttribArray(q);
    for (const [color, points] of trails) {
      if (points.length < 6) continue;
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, points, gl.STREAM_DRAW);
      gl.vertexAttribPointer(q, 3, gl.FLOAT, false, 0, 0);
      gl.uniform4fv(gl.getUniformLocation(line, "c"), color);
      gl.drawArrays(gl.LINE_STRIP, 0, points.length / 3);
      gl.deleteBuffer(buffer);
    }
  }
  let held = null;
  canvas.onpointerdown = event => { held = event; canvas.setPointerCapture(event.pointerId); };
  canvas.onpointerup = () => { held = null; };
  canvas.onpointermove = event => {
    if (!held) return;
    const dx = event.clientX - held.clientX, dy = event.clientY - held.clientY;
    if (event.shiftKey || event.buttons === 2) {
      const s = eye.far / 700, a = eye.turn;
      eye.at = [eye.at[0] + s * dx * Math.sin(a), eye.at[1] - s * dx * Math.cos(a), eye.at[2] + s * dy];
    } else {
      eye.turn -= dx / 150;
      eye.tilt = Math.max(-1.5, Math.min(1.5, eye.tilt + dy / 150));
    }
    held = event;
    redraw();
  };
  canvas.oncontextmenu = event => event.preventDefault();
  canvas.onwheel = event => {
    event.preventDefault();
    eye.far = Math.max(0.1, Math.min(40, eye.far * Math.exp(event.deltaY / 800)));
    redraw();
  };
  return draw;
}
