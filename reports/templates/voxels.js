"use strict";
(() => {
  const viewer = document.querySelector(".slices");
  if (!viewer) return;
  const find = (selector) => viewer.querySelector(selector);
  const [level, quantity, axis, layer] = ["level", "quantity", "axis", "layer"].map((name) =>
    find(`[name=${name}]`)
  );
  const canvas = find("canvas");
  const context = canvas.getContext("2d");
  const cache = new Map();

  // The pixels of an atlas: layers along z, side by side.
  const atlas = async (image) => {
    if (!cache.has(image)) {
      await image.decode();
      const sheet = document.createElement("canvas");
      sheet.width = image.naturalWidth;
      sheet.height = image.naturalHeight;
      const drawing = sheet.getContext("2d", { willReadFrequently: true });
      drawing.drawImage(image, 0, 0);
      cache.set(image, drawing.getImageData(0, 0, sheet.width, sheet.height));
    }
    return cache.get(image);
  };

  const draw = async () => {
    const block = document.getElementById(`slices-${level.value}`);
    const edge = Number(block.dataset.edge);
    const columns = Number(block.dataset.columns);
    layer.max = edge - 1;
    const across = Number(axis.value);
    const place = Math.min(Number(layer.value), edge - 1);
    const source = await atlas(block.querySelector(`.${quantity.value}`));
    canvas.width = canvas.height = edge;
    const picture = context.createImageData(edge, edge);
    // To the right x, y or z of the next axis in cyclic order, upwards the one after it.
    const right = (across + 1) % 3;
    const up = (across + 2) % 3;
    const voxel = [0, 0, 0];
    voxel[across] = place;
    for (let row = 0; row < edge; row++) {
      voxel[up] = edge - 1 - row;
      for (let column = 0; column < edge; column++) {
        voxel[right] = column;
        const [x, y, z] = voxel;
        const sheetX = (z % columns) * edge + x;
        const sheetY = Math.floor(z / columns) * edge + y;
        const from = 4 * (sheetY * source.width + sheetX);
        const to = 4 * (row * edge + column);
        for (let channel = 0; channel < 3; channel++) {
          picture.data[to + channel] = source.data[from + channel];
        }
        picture.data[to + 3] = 255;
      }
    }
    context.putImageData(picture, 0, 0);
    const lowest = JSON.parse(block.dataset.lowest)[across];
    const size = Number(block.dataset.size);
    const names = ["x", "y", "z"];
    const begin = lowest + place * size;
    find("output").textContent =
      `layer ${place} of ${edge}: ${names[across]} from ${begin.toPrecision(5)} to ` +
      `${(begin + size).toPrecision(5)}; ${names[right]} to the right, ${names[up]} up`;
  };

  for (const control of [level, quantity, axis, layer]) control.addEventListener("input", draw);
  layer.value = Math.floor(Number(layer.max) / 2);
  draw();
})();
