/** From the world (m, y up) to the canvas (CSS pixels, y down) and back. */

export class Camera {
  constructor() {
    this.width = this.height = 1;
    this.x = this.y = 0; // world point in the middle of the canvas
    this.scale = 50; // pixels a metre
  }

  /** Shows a box [x_min, y_min, x_max, y_max] with a margin in pixels. */
  fit([x0, y0, x1, y1], margin = { left: 74, right: 24, top: 22, bottom: 38 }) {
    const w = Math.max(50, this.width - margin.left - margin.right);
    const h = Math.max(50, this.height - margin.top - margin.bottom);
    this.scale = Math.min(w / Math.max(x1 - x0, 1e-3), h / Math.max(y1 - y0, 1e-3));
    this.x = (x0 + x1) / 2 + (margin.right - margin.left) / 2 / this.scale;
    this.y = (y0 + y1) / 2 + (margin.top - margin.bottom) / 2 / this.scale;
  }

  toScreen([x, y]) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  toWorld([px, py]) {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  /** Zooms by a factor, keeping the world under a pixel where it is. */
  zoom(factor, pixel = [this.width / 2, this.height / 2]) {
    const held = this.toWorld(pixel);
    this.scale = Math.min(5000, Math.max(0.02, this.scale * factor));
    const now = this.toWorld(pixel);
    this.x += held[0] - now[0];
    this.y += held[1] - now[1];
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** Lets a context draw in metres. `ratio` is the canvas's pixels per CSS pixel. */
  apply(context, ratio) {
    const k = this.scale * ratio;
    context.setTransform(
      k,
      0,
      0,
      -k,
      ratio * (this.width / 2) - k * this.x,
      ratio * (this.height / 2) + k * this.y,
    );
  }
}
