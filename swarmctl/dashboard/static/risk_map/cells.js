// The cells: P_s as shades, what is believed, what is unseen, and the scale of the shades.

const SEEN = 1, OCCUPIED = 2, OWN = 4;

function mixed(a, b, share) {
  return a.map((value, i) => Math.round(value + (b[i] - value) * share));
}

// Light to dark in one hue family: legible in grey print and for colour-blind readers.
const STOPS = {
  light: [[255, 255, 255], [253, 212, 158], [252, 141, 89], [179, 0, 0], [80, 0, 0]],
  dark: [[24, 28, 34], [74, 48, 36], [170, 80, 30], [240, 160, 60], [255, 235, 180]],
};

function shade(share, isDark) {
  const stops = isDark ? STOPS.dark : STOPS.light;
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2);
  return mixed(stops[i], stops[i + 1], at - i);
}

export default {
  // The paper's grey is the same in both views: white for none.
  has_dark_cells() {
    return this.options.dark && this.options.shading !== "paper";
  },
  // The cells are painted once a change, one pixel a cell, and drawn enlarged with each frame.
  paint_cells() {
    if (!this.area) return;
    const { rows, cols } = this.area, dark = this.options.dark, codes = this.belief;
    const cells = (this.cells ??= document.createElement("canvas"));
    cells.width = cols;
    cells.height = rows;
    const context = cells.getContext("2d"), image = context.createImageData(cols, rows);
    for (let row = 0; row < rows; row++) {
      for (let col = 0; col < cols; col++) {
        const i = row * cols + col, code = codes?.[i] ?? 0, at = 4 * ((rows - 1 - row) * cols + col);
        const share = this.exposure ? this.exposure[i] / 255 : 0;
        let colour = shade(this.options.shading === "heat" ? share : 0, dark);
        if (this.options.shading === "paper") {
          const grey = Math.round(255 * (1 - share));
          colour = [grey, grey, grey];
        }
        if (code & OCCUPIED) colour = this.has_dark_cells() ? [255, 255, 255] : [40, 0, 0];
        image.data.set([...colour, 255], at);
      }
    }
    context.putImageData(image, 0, 0);
  },
  draw_cells(context) {
    const { rows, cols, cell_size_m } = this.area, cell = cell_size_m * this.view.scale;
    const [left, top] = this.place([0, rows * cell_size_m]);
    context.imageSmoothingEnabled = false;
    if (this.cells) context.drawImage(this.cells, left, top, cols * cell, rows * cell);
    const codes = this.belief;
    if (cell >= 4) {
      context.beginPath();
      for (let row = 0; row < rows; row++) {
        for (let col = 0; col < cols; col++) {
          if ((codes?.[row * cols + col] ?? 0) & SEEN) continue;
          const x = left + col * cell, y = top + (rows - 1 - row) * cell;
          context.moveTo(x, y + cell);
          context.lineTo(x + cell, y);
        }
      }
      context.strokeStyle = this.has_dark_cells() ? "rgba(255,255,255,0.16)" : "rgba(0,0,0,0.16)";
      context.lineWidth = 1;
      context.stroke();
    }
    if (this.whose && cell >= 8) this.draw_own(context, codes, left, top, cell);
    context.strokeStyle = this.ink;
    context.lineWidth = 1;
    context.strokeRect(left, top, cols * cell, rows * cell);
  },
  // Cells that the chosen vehicle has seen itself carry a dot of its colour; heard cells carry none.
  draw_own(context, codes, left, top, cell) {
    const { rows, cols } = this.area;
    context.fillStyle = this.vehicles[this.whose].colour;
    for (let i = 0; i < (codes?.length ?? 0); i++) {
      if (!(codes[i] & OWN)) continue;
      const x = left + ((i % cols) + 0.5) * cell, y = top + (rows - 0.5 - Math.floor(i / cols)) * cell;
      context.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
  },
  // P_s from 0 to the darkest shade, at the lower left of the map.
  draw_scale(context) {
    const { dark, shading } = this.options, { clientHeight } = context.canvas, wide = 90, high = 10;
    const top = clientHeight - 16 - (this.options.tiles ? 14 : 0), left = 8;
    context.fillStyle = dark ? "rgba(16, 20, 24, 0.8)" : "rgba(255, 255, 255, 0.85)";
    context.fillRect(left - 4, top - 5, wide + 88, high + 10);
    for (let x = 0; x < wide; x++) {
      const share = x / wide, grey = Math.round(255 * (1 - share));
      context.fillStyle = `rgb(${shading === "paper" ? [grey, grey, grey] : shade(share, dark)})`;
      context.fillRect(left + x, top, 1, high);
    }
    context.lineWidth = 1;
    context.strokeStyle = context.fillStyle = this.ink;
    context.strokeRect(left, top, wide, high);
    context.font = "11px system-ui, sans-serif";
    context.fillText(`P_s 0 to ${this.largest.toFixed(2)}`, left + wide + 8, top + high - 1);
  },
};
