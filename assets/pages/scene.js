// What a scene is drawn with: WebGL, and nothing else. `sceneOn` gives `draw`, or null.
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
// Light from above, a gleam, and a floor with a grid that fades away.
// A texture is projected along the axis of its frame that is nearest to the normal, as in texel_at
// of sim/ray_trace_kernels.py: k and h bring points and normals there, b has the sizes of the image.
const SURFACE = ["attribute vec3 p, n; uniform mat4 m, v, k; uniform mat3 h; varying vec3 d, w, q, r; void main() {" +
  "vec4 x = m * vec4(p, 1.0); w = x.xyz; d = mat3(m[0].xyz, m[1].xyz, m[2].xyz) * n; gl_Position = v * x;" +
  "q = (k * vec4(p, 1.0)).xyz; r = h * n; }",
  "precision highp float; varying vec3 d, w, q, r; uniform vec4 c; uniform vec3 e, f; uniform float g;" +
  "uniform sampler2D i; uniform vec2 b[3]; uniform float j;" +
  "vec3 texel(vec2 z) { return texture2D(i, vec2(fract(z.x + 0.5), 1.0 - fract(z.y + 0.5))).rgb; }" +
  "vec3 skin() { vec3 o = abs(r);" +
  "if (o.z >= o.x && o.z >= o.y) return texel(vec2(q.x, r.z > 0.0 ? q.y : -q.y) / b[2]);" +
  "if (o.x >= o.y) return texel(vec2(r.x > 0.0 ? q.y : -q.y, q.z) / b[0]);" +
  "return texel(vec2(r.y > 0.0 ? -q.x : q.x, q.z) / b[1]); }" +
  "void main() { vec3 base = j > 0.5 ? skin() : c.rgb;" +
  "vec3 u = normalize(d), t = normalize(e - w); if (dot(u, t) < 0.0) u = -u;" +
  "float far = distance(e, w), k = max(0.0, dot(u, normalize(vec3(0.4, -0.5, 0.77))));" +
  "vec3 h = normalize(t + vec3(0.4, -0.5, 0.77)); float s = 0.18 * pow(max(0.0, dot(u, h)), 40.0);" +
  "vec3 l = base * (0.50 + 0.38 * k + 0.14 * u.z) + s; float a = c.a;" +
  "if (g > 0.5) { vec2 q = abs(fract(w.xy * 2.0 - 0.5) - 0.5) / 2.0; float r = 0.0011 * far;" +
  "l = c.rgb * (1.0 - 0.10 * (1.0 - smoothstep(0.4 * r, 1.6 * r, min(q.x, q.y))));" +
  "a *= 1.0 - smoothstep(1.6 * g, 3.6 * g, distance(w.xy, f.xy)); }" +
  "gl_FragColor = vec4(l, a); }"];
const SHADE = ["attribute vec3 p; uniform mat4 m, v; void main() { vec4 x = m * vec4(p, 1.0);" +
  "x.xyz -= (x.z - 0.001) / 0.77 * vec3(0.4, -0.5, 0.77) * step(0.0, x.z); gl_Position = v * x; }",
  "precision mediump float; uniform vec4 c; void main() { gl_FragColor = c; }"];
// A line is a strip of so many pixels between two points a and b.
const LINE = ["attribute vec3 a, b; attribute vec2 s; uniform mat4 v; uniform vec2 z; uniform float w; void main() {" +
  "vec4 p = v * vec4(a, 1.0), q = v * vec4(b, 1.0), o = s.x < 0.5 ? p : q;" +
  "vec2 d = normalize((q.xy / q.w - p.xy / p.w) * z + vec2(1e-6, 0.0));" +
  "o.xy += vec2(-d.y, d.x) / z * s.y * w * o.w; gl_Position = o; }",
  "precision mediump float; uniform vec4 c; void main() { gl_FragColor = c; }"];
const SIDES = [0, -1, 1, -1, 1, 1, 0, -1, 1, 1, 0, 1];
// Corners of the strips between points; each to the next one, or two and two.
function strips(points, apart) {
  const count = apart ? Math.floor(points.length / 6) : Math.max(0, points.length / 3 - 1);
  const made = new Float32Array(48 * count), every = apart ? 6 : 3;
  for (let i = 0, k = 0; i < count; i++) for (let j = 0; j < 6; j++) {
    for (let d = 0; d < 6; d++) made[k++] = points[every * i + d];
    made[k++] = SIDES[2 * j];
    made[k++] = SIDES[2 * j + 1];
  }
  return made;
}
function sceneOn(canvas, meshes, textures, middle, redraw, far = 2.5) {
  const gl = canvas.getContext("webgl", { alpha: false, antialias: true, stencil: true });
  if (!gl) return null;
  const buffers = new Map(), images = new Map();
  const program = compiled(gl, ...SURFACE), shade = compiled(gl, ...SHADE), line = compiled(gl, ...LINE);
  const eye = { at: middle, far, turn: -0.9, tilt: 0.45 };
  // Triangles of a shape; none of a mesh that has not come yet.
  function bufferOf(name) {
    if (!buffers.has(name)) {
      const mesh = meshes[name];
      if (!mesh && !shapes[name]) return null;
      const made = mesh || shapes[name]();
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, made, gl.STATIC_DRAW);
      buffers.set(name, { buffer, count: made.length / 6 });
    }
    return buffers.get(name);
  }
  // The image of a texture; null until the browser has read it.
  function imageOf(name) {
    if (!images.has(name)) {
      images.set(name, null);
      const picture = new Image();
      picture.onload = () => {
        const made = gl.createTexture();
        gl.bindTexture(gl.TEXTURE_2D, made);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, picture);
        for (const [what, value] of [[gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST],
          [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
          gl.texParameteri(gl.TEXTURE_2D, what, value);
        }
        images.set(name, made);
        redraw();
      };
      picture.src = textures[name];
    }
    return images.get(name);
  }
  function view() {
    const c = Math.cos(eye.tilt);
    const away = [c * Math.cos(eye.turn), c * Math.sin(eye.turn), Math.sin(eye.tilt)];
    const from = eye.at.map((x, i) => x + eye.far * away[i]);
    const wide = canvas.width / Math.max(1, canvas.height);
    return [times(perspective(0.8, wide, 0.05, 60), lookAt(from, eye.at)), from];
  }
  const at = (program, name) => gl.getUniformLocation(program, name);
  function surfaces(drawn, poses, seen, from, program) {
    gl.useProgram(program);
    gl.uniformMatrix4fv(at(program, "v"), false, seen);
    const p = gl.getAttribLocation(program, "p"), n = gl.getAttribLocation(program, "n");
    gl.enableVertexAttribArray(p);
    if (from) {
      gl.enableVertexAttribArray(n);
      gl.uniform3fv(at(program, "e"), from);
      gl.uniform3fv(at(program, "f"), eye.at);
    }
    for (const shape of drawn) {
      const found = bufferOf(shape.name), pose = poses.subarray(7 * shape.body, 7 * shape.body + 7);
      if (!found || (!from && shape.name === "plane")) continue;
      const body = fromPose(pose.subarray(0, 3), pose.subarray(3, 7), [1, 1, 1]);
      gl.bindBuffer(gl.ARRAY_BUFFER, found.buffer);
      gl.vertexAttribPointer(p, 3, gl.FLOAT, false, 24, 0);
      gl.uniformMatrix4fv(at(program, "m"), false,
        times(body, fromPose(shape.position, shape.quaternion, shape.scale)));
      if (from) {
        gl.vertexAttribPointer(n, 3, gl.FLOAT, false, 24, 12);
        gl.uniform4fv(at(program, "c"), shape.color);
        const texture = shape.texture, image = texture ? imageOf(texture.image) : null;
        gl.uniform1f(at(program, "j"), image ? 1 : 0);
        if (image) {
          gl.bindTexture(gl.TEXTURE_2D, image);
          gl.uniformMatrix4fv(at(program, "k"), false, texture.place);
          gl.uniformMatrix3fv(at(program, "h"), false, texture.facing);
          gl.uniform2fv(at(program, "b"), texture.tiles);
        }
        gl.uniform1f(at(program, "g"), shape.name === "plane" ? Math.max(1, far / 2.5) : 0);
      }
      gl.drawArrays(gl.TRIANGLES, 0, found.count);
    }
    if (from) gl.disableVertexAttribArray(n);
    gl.disableVertexAttribArray(p);
  }
  // What stands on the floor darkens it, each place once.
  function shadows(drawn, poses, seen) {
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    gl.useProgram(shade);
    gl.uniform4fv(at(shade, "c"), [0.1, 0.14, 0.22, 0.20]);
    surfaces(drawn, poses, seen, null, shade);
    gl.depthMask(true);
    gl.disable(gl.STENCIL_TEST);
  }
  function lines(ways, seen) {
    gl.useProgram(line);
    gl.uniformMatrix4fv(at(line, "v"), false, seen);
    gl.uniform2fv(at(line, "z"), [canvas.width, canvas.height]);
    const places = ["a", "b", "s"].map(name => gl.getAttribLocation(line, name));
    for (const place of places) gl.enableVertexAttribArray(place);
    for (const [color, points, width = 2, apart = false] of ways) {
      if (points.length < 6) continue;
      const made = strips(points, apart), buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, made, gl.STREAM_DRAW);
      gl.vertexAttribPointer(places[0], 3, gl.FLOAT, false, 32, 0);
      gl.vertexAttribPointer(places[1], 3, gl.FLOAT, false, 32, 12);
      gl.vertexAttribPointer(places[2], 2, gl.FLOAT, false, 32, 24);
      gl.uniform1f(at(line, "w"), width * (window.devicePixelRatio || 1));
      gl.uniform4fv(at(line, "c"), color);
      gl.drawArrays(gl.TRIANGLES, 0, made.length / 8);
      gl.deleteBuffer(buffer);
    }
    for (const place of places) gl.disableVertexAttribArray(place);
  }
  // Shapes of a generation, poses of its bodies (seven numbers each), ways as [color, points,
  // pixels wide, whether points belong two and two].
  function draw(drawn, poses, ways) {
    const ratio = window.devicePixelRatio || 1;
    const size = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.90, 0.92, 0.94, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const [seen, from] = view();
    const floors = drawn.filter(shape => shape.name === "plane");
    const solid = drawn.filter(shape => shape.name !== "plane");
    surfaces(floors, poses, seen, from, program);
    if (floors.length) shadows(solid, poses, seen);
    surfaces(solid, poses, seen, from, program);
    lines(ways, seen);
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
