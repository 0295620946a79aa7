// The background map below the cells.

const EARTH_ROUND_M = 40075016.7, MAX_TILES = 64;

export default {
  // Tiles in Web Mercator below the cells. The corners of the area give the place of a longitude and latitude;
  // over a few kilometres both are linear.
  draw_tiles(context, tiles) {
    const { corners, rows, cols, cell_size_m } = this.area, [[lat, lon], [, lon_east], [lat_north]] = corners;
    const lon_per_m = (lon_east - lon) / (cols * cell_size_m), lat_per_m = (lat_north - lat) / (rows * cell_size_m);
    const across_m = EARTH_ROUND_M * Math.cos((lat * Math.PI) / 180);
    const fitting = Math.round(Math.log2((across_m * this.view.scale) / 256));
    const zoom = Math.min(Math.max(fitting, tiles.min_zoom), tiles.max_zoom), n = 2 ** zoom;
    const column = (east) => ((lon + east * lon_per_m + 180) / 360) * n;
    const row = (north) => {
      const angle = ((lat + north * lat_per_m) * Math.PI) / 180;
      return ((1 - Math.asinh(Math.tan(angle)) / Math.PI) / 2) * n;
    };
    const east = (x) => ((x / n) * 360 - 180 - lon) / lon_per_m;
    const north = (y) => ((Math.atan(Math.sinh(Math.PI * (1 - (2 * y) / n))) * 180) / Math.PI - lat) / lat_per_m;
    const { clientWidth, clientHeight } = context.canvas;
    const [west_m, north_m] = this.where([0, 0]), [east_m, south_m] = this.where([clientWidth, clientHeight]);
    const left = Math.floor(column(west_m)), right = Math.floor(column(east_m));
    const top = Math.floor(row(north_m)), bottom = Math.floor(row(south_m));
    if ((right - left + 1) * (bottom - top + 1) > MAX_TILES) return;
    for (let x = left; x <= right; x++) {
      for (let y = top; y <= bottom; y++) {
        const image = this.tile(tiles.template.replace("{z}", zoom).replace("{x}", x).replace("{y}", y));
        if (!image.naturalWidth) continue;
        const [x0, y0] = this.place([east(x), north(y)]), [x1, y1] = this.place([east(x + 1), north(y + 1)]);
        context.drawImage(image, x0, y0, x1 - x0, y1 - y0);
      }
    }
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = this.ink;
    context.fillText(tiles.attribution, 6, clientHeight - 6);
  },
  tile(address) {
    this.images ??= new Map();
    let image = this.images.get(address);
    if (!image) {
      image = new Image();
      image.onload = () => this.draw_soon();
      image.src = address;
      this.images.set(address, image);
      if (this.images.size > 4 * MAX_TILES) this.images.delete(this.images.keys().next().value);
    }
    return image;
  },
};
