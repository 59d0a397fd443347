// The moving things on the map: scan, path, people, the chair. One canvas, redrawn with each view.

/* global L */

const COLOURS = ["scan", "path", "person", "chair", "chair-edge", "lost"];

export const Overlay = L.Layer.extend({
  initialize() {
    this._canvas = L.DomUtil.create("canvas", "leaflet-zoom-hide overlay");
    this._drawn = null;
    this.readColours();
  },

  /** Reads the colours of the style sheet; called again when the colour scheme changes. */
  readColours() {
    const style = getComputedStyle(document.documentElement);
    this._colour = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--map-${name}`).trim()]));
    this.redraw();
  },

  onAdd(map) {
    this._map = map;
    const pane = map.getPane("chair") ?? map.createPane("chair"); // above the places, transparent to presses
    pane.append(this._canvas);
    map.on("move zoomend viewreset resize", this.redraw, this);
    this.redraw();
  },

  onRemove(map) {
    this._canvas.remove();
    map.off("move zoomend viewreset resize", this.redraw, this);
  },

  /** {pose, outline, scan, path, people, localisation} with points as [lat, lng]. */
  show(drawn) {
    this._drawn = drawn;
    this.redraw();
  },

  redraw() {
    if (!this._map) return;
    const size = this._map.getSize();
    const ratio = devicePixelRatio || 1;
    const canvas = this._canvas;
    L.DomUtil.setPosition(canvas, this._map.containerPointToLayerPoint([0, 0]));
    if (canvas.width !== Math.round(size.x * ratio) || canvas.height !== Math.round(size.y * ratio)) {
      [canvas.width, canvas.height] = [Math.round(size.x * ratio), Math.round(size.y * ratio)];
      [canvas.style.width, canvas.style.height] = [`${size.x}px`, `${size.y}px`];
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, size.x, size.y);
    if (this._drawn) this._draw(context, this._drawn);
  },

  _at(point) {
    const projected = this._map.project(point).subtract(this._map.getPixelOrigin());
    return this._map.layerPointToContainerPoint(projected);
  },

  _metre() {
    return this._map.options.crs.scale(this._map.getZoom());
  },

  _draw(context, { pose, outline, scan, path, people, localisation }) {
    context.lineJoin = context.lineCap = "round";
    this._drawPath(context, path);
    context.fillStyle = this._colour.scan;
    const dot = Math.max(1.5, Math.min(3, 0.03 * this._metre()));
    for (const point of scan) {
      const { x, y } = this._at(point);
      context.fillRect(x - dot / 2, y - dot / 2, dot, dot);
    }
    for (const point of people) this._drawPerson(context, point);
    if (pose) this._drawChair(context, outline, pose, localisation);
  },

  _drawPath(context, path) {
    if (path.length < 2) return;
    context.beginPath();
    for (const point of path) {
      const { x, y } = this._at(point);
      context.lineTo(x, y);
    }
    context.strokeStyle = this._colour.path;
    context.lineWidth = 5;
    context.stroke();
    const end = this._at(path[path.length - 1]);
    context.beginPath();
    context.arc(end.x, end.y, 9, 0, 2 * Math.PI);
    context.lineWidth = 3;
    context.stroke();
  },

  _drawPerson(context, point) {
    const { x, y } = this._at(point);
    context.beginPath();
    context.arc(x, y, Math.max(7, 0.28 * this._metre()), 0, 2 * Math.PI);
    context.fillStyle = this._colour.person;
    context.fill();
    context.lineWidth = 2;
    context.strokeStyle = this._colour["chair-edge"];
    context.stroke();
  },

  /** Draws the footprint with an arrow, and a ring while the chair is unsure of its place. */
  _drawChair(context, outline, { at, heading }, localisation) {
    const colour = localisation === "lost" ? this._colour.lost : this._colour.chair;
    const { x, y } = this._at(at);
    const scale = this._metre();
    context.save();
    context.translate(x, y);
    context.rotate(-heading);
    context.beginPath();
    for (const [forward, left] of outline) context.lineTo(forward * scale, -left * scale);
    context.closePath();
    context.fillStyle = colour;
    context.strokeStyle = this._colour["chair-edge"];
    context.lineWidth = 2;
    context.fill();
    context.stroke();
    const size = Math.max(9, 0.22 * scale);
    const middle = outline.reduce((sum, [forward]) => sum + forward, 0) / Math.max(1, outline.length);
    context.translate(middle * scale, 0);
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-0.8 * size, 0.75 * size);
    context.lineTo(-0.4 * size, 0);
    context.lineTo(-0.8 * size, -0.75 * size);
    context.closePath();
    context.fillStyle = this._colour["chair-edge"];
    context.fill();
    context.restore();
    if (localisation === "ok") return;
    context.beginPath();
    context.arc(x, y, Math.max(26, 0.9 * scale), 0, 2 * Math.PI);
    context.setLineDash([6, 6]);
    context.strokeStyle = colour;
    context.lineWidth = 3;
    context.stroke();
    context.setLineDash([]);
  },
});
