"use strict";
// Draws a scene (workbench/report/pack.py) with WebGL 2: points with eye-dome lighting, then lines. Used by viewer.js.
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const Painter = (() => {
const POINTS = `#version 300 es
layout(location = 0) in vec3 steps; layout(location = 1) in uint index;
uniform mat3 turn; uniform vec3 target, span, middle; uniform float step, size; uniform sampler2D palette; flat out vec3 colour;
void main() {
  vec3 p = (turn * (middle + step * steps - target)) * span;
  gl_Position = vec4(p.xy, -p.z, 1.0); gl_PointSize = size;
  colour = texelFetch(palette, ivec2(int(index), 0), 0).rgb;
}`;
const DISC = `#version 300 es
precision mediump float; flat in vec3 colour; out vec4 shown;
void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; shown = vec4(colour, 1.0); }`;
const SCREEN = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;
// After eye-dome lighting (Boucheny 2009): dark where both neighbours across a point, taken together, stand before it.
// So planes keep the legend's colours however they are inclined, and corners and outlines show.
const LIGHT = `#version 300 es
precision highp float; uniform highp sampler2D depths, colours; uniform float slope; uniform int reach; out vec4 shown;
float before(ivec2 at, float depth) { return depth - texelFetch(depths, clamp(at, ivec2(0), textureSize(depths, 0) - 1), 0).r; }
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy); float depth = texelFetch(depths, at, 0).r, dark = 0.0;
  if (depth == 1.0) discard;
  for (int k = 0; k < 4; k++) {
    ivec2 to = reach * (k == 0 ? ivec2(1, 0) : k == 1 ? ivec2(0, 1) : k == 2 ? ivec2(1, 1) : ivec2(1, -1));
    float one = clamp(before(at + to, depth) * slope, -4.0, 4.0), other = clamp(before(at - to, depth) * slope, -4.0, 4.0);
    dark += clamp(one + other - 0.7, 0.0, 3.0) + 0.06 * (max(one, 0.0) + max(other, 0.0));
  }
  shown = vec4(texelFetch(colours, at, 0).rgb * (0.35 + 0.65 * exp(-0.22 * dark)), 1.0); gl_FragDepth = depth;
}`;
const LINES = `#version 300 es
layout(location = 0) in vec3 from; layout(location = 1) in vec3 to; layout(location = 2) in vec4 tint;
uniform mat3 turn; uniform mat4 moved; uniform vec3 target, span; uniform vec2 pixel; uniform float width; out vec3 colour;
vec3 seen(vec3 at) { return (turn * ((moved * vec4(at, 1.0)).xyz - target)) * span; }
void main() {
  vec3 a = seen(from), b = seen(to);
  vec2 along = (b.xy - a.xy) / pixel; along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  float end = float(gl_VertexID / 2), side = float(gl_VertexID % 2) * 2.0 - 1.0;
  vec2 off = (vec2(-along.y, along.x) * side + along * (end - 0.5)) * 0.5 * width * pixel * tint.a;
  vec3 p = mix(a, b, end * tint.a); gl_Position = vec4(p.xy + off, -p.z - 0.1 * span.z, 1.0); colour = tint.rgb;
}`;
const PLAIN = `#version 300 es
precision mediump float; in vec3 colour; uniform float opacity; out vec4 shown;
void main() { shown = vec4(colour, opacity); }`;

const STANDS = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

return class {
  constructor(canvas, data) {
    this.canvas = canvas;
    this.data = data;
    this.gl = canvas.getContext("webgl2", { antialias: true });
    if (!this.gl) throw new Error("no WebGL 2");
    this.prepare();
  }

  // What the graphics processor holds; made again after a lost context.
  prepare() {
    const gl = this.gl, data = this.data;
    this.programs = [[POINTS, DISC], [SCREEN, LIGHT], [LINES, PLAIN]].map((pair) => this.program(...pair));
    this.pointArray = gl.createVertexArray();
    gl.bindVertexArray(this.pointArray);
    this.buffer(bytes(data.points));
    gl.vertexAttribPointer(0, 3, gl.SHORT, false, 6, 0);
    gl.enableVertexAttribArray(0);
    gl.enableVertexAttribArray(1);
    this.indices = data.shadings.map((each) => this.buffer(bytes(each.index)));
    this.palettes = data.shadings.map((each) => this.texture(gl.RGB8, 256, 1, gl.RGB, gl.UNSIGNED_BYTE, bytes(each.palette)));
    this.strokes = data.strokes.map((each) => ({ ...this.lineArray(bytes(each.points), bytes(each.colours)),
      moved: each.moved && new Float32Array(bytes(each.moved).buffer) }));
    this.outlines = data.marks.map(({ outline, colour }) => this.lineArray(new Float32Array(outline.flat()),
      new Uint8Array(outline.flatMap((_, k) => [...rgb(colour), k ? 255 : 0]))));
    this.frame = null;
  }

  program(...sources) {
    const gl = this.gl, made = gl.createProgram();
    sources.forEach((source, k) => {
      const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    });
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return (name) => (name ? gl.getUniformLocation(made, name) : made);
  }

  buffer(content) {
    const gl = this.gl, made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, content, gl.STATIC_DRAW);
    return made;
  }

  texture(inner, width, height, format, type, content) {
    const gl = this.gl, made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, format, type, content);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    return made;
  }

  lineArray(points, colours) { // a point and the next are a rectangle; none where no line leads to the next: alpha 0
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    this.buffer(points);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 12, 12);
    this.buffer(colours);
    gl.vertexAttribPointer(2, 4, gl.UNSIGNED_BYTE, true, 4, 4);
    for (const k of [0, 1, 2]) gl.enableVertexAttribArray(k), gl.vertexAttribDivisor(k, 1);
    return { array, count: colours.byteLength / 4 - 1 };
  }

  resize(width, height) { // in the page's pixels
    this.ratio = Math.min(2, window.devicePixelRatio || 1);
    this.canvas.width = Math.max(1, Math.round(width * this.ratio));
    this.canvas.height = Math.max(1, Math.round(height * this.ratio));
    this.frame = null;
  }

  // view: `screen` (right, up, towards the viewer), `target`, `scale` in pixels a mm, `depth` in mm on both sides of the
  // target, `shading`, `chosen` outline or null, `frame` that is played; `shown`: points, each group of strokes, outlines.
  draw(view) {
    const gl = this.gl, { width, height } = this.canvas, per = 2 * view.scale * this.ratio;
    if (gl.isContextLost()) return;
    const span = [per / width, per / height, 1 / view.depth];
    this.camera = { turn: view.screen.flat(), target: view.target, span, pixel: [2 / width, 2 / height] };
    this.played = view.frame;
    this.frame ??= this.frameBuffer(width, height);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    this.clear(this.frame.buffer);
    if (this.data.blocks.length && view.shown[0]) this.drawPoints(view);
    this.clear(null);
    this.light(view);
    const lines = [...(view.shown.at(-1) ? this.outlines : []), ...this.strokes.filter((_, k) => view.shown[k + 1])];
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    for (const [how, opacity] of [[gl.GREATER, 0.3], [gl.LEQUAL, 1]]) { // behind the part: faint
      gl.depthFunc(how);
      gl.depthMask(how === gl.LEQUAL);
      for (const each of lines) this.drawLines(each, 2, opacity);
    }
    gl.disable(gl.DEPTH_TEST);
    if (view.chosen !== null) this.drawLines(this.outlines[view.chosen], 4.5, 1);
    gl.disable(gl.BLEND);
  }

  clear(buffer) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.depthFunc(gl.LEQUAL);
    gl.depthMask(true);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  frameBuffer(width, height) {
    const gl = this.gl, buffer = gl.createFramebuffer();
    for (const each of this.held ?? []) gl.deleteTexture(each);
    const colours = this.texture(gl.RGBA8, width, height, gl.RGBA, gl.UNSIGNED_BYTE, null);
    const depths = this.texture(gl.DEPTH_COMPONENT24, width, height, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, colours, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depths, 0);
    this.held = [colours, depths];
    return { buffer, colours, depths };
  }

  use(which) {
    const gl = this.gl, program = this.programs[which];
    gl.useProgram(program());
    gl.uniformMatrix3fv(program("turn"), true, this.camera.turn);
    gl.uniform3fv(program("target"), this.camera.target);
    gl.uniform3fv(program("span"), this.camera.span);
    return program;
  }

  drawPoints(view) {
    const gl = this.gl, program = this.use(0), pitch = this.data.pitch_mm * view.scale;
    gl.bindVertexArray(this.pointArray);
    gl.bindTexture(gl.TEXTURE_2D, this.palettes[view.shading]);
    gl.uniform1f(program("size"), this.ratio * Math.min(14, Math.max(2.5, 2.4 * pitch)));
    gl.bindBuffer(gl.ARRAY_BUFFER, this.indices[view.shading]);
    gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_BYTE, 1, 0);
    this.data.blocks.reduce((first, [x, y, z, step, count]) => {
      gl.uniform3f(program("middle"), x, y, z);
      gl.uniform1f(program("step"), step);
      gl.drawArrays(gl.POINTS, first, count);
      return first + count;
    }, 0);
  }

  light({ depth, scale }) {
    const gl = this.gl, program = this.use(1), reach = Math.max(1, Math.round(1.5 * this.ratio));
    for (const [unit, texture] of [[gl.TEXTURE1, this.frame.depths], [gl.TEXTURE0, this.frame.colours]]) {
      gl.activeTexture(unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    }
    gl.uniform1i(program("depths"), 1);
    gl.uniform1f(program("slope"), 2 * depth * scale * this.ratio / reach);
    gl.uniform1i(program("reach"), reach);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  drawLines({ array, count, moved }, width, opacity) {
    const gl = this.gl, program = this.use(2), first = 16 * this.played;
    gl.uniformMatrix4fv(program("moved"), false, moved ? moved.subarray(first, first + 16) : STANDS);
    gl.uniform2fv(program("pixel"), this.camera.pixel);
    gl.uniform1f(program("width"), width * this.ratio);
    gl.uniform1f(program("opacity"), opacity);
    gl.bindVertexArray(array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }
};
})();
