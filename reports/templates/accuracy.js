"use strict";
(() => {
  document.documentElement.classList.add("js");

  // Deflated half-precision planes (see reports/pictures.py, linear_payload) to linear RGB.
  const decode = async (script, pixelCount) => {
    const packed = Uint8Array.from(atob(script.textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const octets = new Uint8Array(await new Response(stream).arrayBuffer());
    const linear = new Float32Array(3 * pixelCount);
    for (let channel = 0; channel < 3; channel++) {
      const high = 2 * channel * pixelCount;
      for (let pixel = 0; pixel < pixelCount; pixel++) {
        const bits = (octets[high + pixel] << 8) | octets[high + pixelCount + pixel];
        linear[3 * pixel + channel] = numberFromHalf(bits);
      }
    }
    return linear;
  };

  const numberFromHalf = (bits) => {
    const sign = bits & 0x8000 ? -1 : 1;
    const exponent = (bits >> 10) & 0x1f;
    const mantissa = bits & 0x3ff;
    if (exponent === 31) return mantissa ? NaN : sign * Infinity;
    if (exponent === 0) return sign * mantissa * 2 ** -24;
    return sign * (1 + mantissa / 1024) * 2 ** (exponent - 15);
  };

  const srgbCode = (linear) => {
    const x = Math.min(Math.max(linear, 0), 1);
    return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
  };

  // The same mapping as srgb_from_linear in reports/pictures.py.
  const drawn = (linear, width, height, exposure) => {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    const picture = context.createImageData(width, height);
    const scale = 2 ** exposure;
    for (let pixel = 0; pixel < width * height; pixel++) {
      const rgb = linear.subarray(3 * pixel, 3 * pixel + 3);
      const finite = rgb.every(Number.isFinite);
      for (let channel = 0; channel < 3; channel++) {
        const code = finite ? srgbCode(rgb[channel] * scale) : [255, 0, 255][channel];
        picture.data[4 * pixel + channel] = code;
      }
      picture.data[4 * pixel + 3] = 255;
    }
    context.putImageData(picture, 0, 0);
    return canvas.toDataURL("image/png");
  };

  let current = null;

  const prepare = (viewer) => {
    const find = (selector) => viewer.querySelector(selector);
    const stage = find(".stage");
    const split = find(".split-range");
    const flipButton = find(".flip");
    const slideButton = find(".slide");
    const exposure = find(".exposure-range");
    const readout = find(".readout");
    const invitation = readout?.textContent;
    const sides = { ours: find("img.ours"), reference: find("img.reference") };
    const recorded = { ours: sides.ours.src, reference: sides.reference.src };
    const width = Number(viewer.dataset.width);
    const height = Number(viewer.dataset.height);
    let linear = null;

    const makeCurrent = () => { current = controls; };
    const slide = () => {
      viewer.classList.remove("flipping", "shows-reference");
      flipButton.setAttribute("aria-pressed", "false");
      slideButton.setAttribute("aria-pressed", "true");
    };
    const flip = () => {
      if (viewer.classList.contains("flipping")) viewer.classList.toggle("shows-reference");
      else viewer.classList.add("flipping", "shows-reference");
      flipButton.setAttribute("aria-pressed", "true");
      slideButton.setAttribute("aria-pressed", "false");
      const shown = viewer.classList.contains("shows-reference") ? "reference" : "VCT";
      flipButton.setAttribute("aria-label", `Flip; now showing ${shown}`);
    };
    const setSplit = (percent) => {
      split.value = String(percent);
      stage.style.setProperty("--split", `${split.value}%`);
    };
    const readLinear = async () => {
      linear ??= Promise.all([
        decode(find(".linear-ours"), width * height),
        decode(find(".linear-reference"), width * height),
      ]);
      return linear;
    };
    const expose = async () => {
      const stops = Number(exposure.value);
      find("output").textContent = `${stops < 0 ? "\u2212" : "+"}${Math.abs(stops)} stops`;
      if (stops === 0) {
        sides.ours.src = recorded.ours;
        sides.reference.src = recorded.reference;
        return;
      }
      const [ours, reference] = await readLinear();
      if (Number(exposure.value) !== stops) return;
      const total = stops + Number(viewer.dataset.exposure);
      sides.ours.src = drawn(ours, width, height, total);
      sides.reference.src = drawn(reference, width, height, total);
    };
    const read = async (event) => {
      const box = stage.getBoundingClientRect();
      const x = Math.floor(((event.clientX - box.left) / box.width) * width);
      const y = Math.floor(((event.clientY - box.top) / box.height) * height);
      if (x < 0 || y < 0 || x >= width || y >= height) return;
      const [ours, reference] = await readLinear();
      const at = (pixels) => Array.from(pixels.subarray(3 * (y * width + x), 3 * (y * width + x) + 3),
        (value) => value.toPrecision(2)).join(" ");
      readout.textContent = `Pixel ${x}, ${y}: VCT ${at(ours)}; reference ${at(reference)} (R G B)`;
    };

    const drag = (event) => {
      const box = stage.getBoundingClientRect();
      setSplit(Math.min(100, Math.max(0, (100 * (event.clientX - box.left)) / box.width)));
    };
    stage.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      makeCurrent();
      if (viewer.classList.contains("flipping")) {
        flip();
      } else {
        stage.setPointerCapture(event.pointerId);
        drag(event);
      }
    });
    stage.addEventListener("pointermove", (event) => {
      if (stage.hasPointerCapture(event.pointerId)) drag(event);
    });
    stage.addEventListener("dragstart", (event) => event.preventDefault());
    split.addEventListener("input", () => { slide(); setSplit(split.value); });
    flipButton.addEventListener("click", flip);
    slideButton.addEventListener("click", slide);
    viewer.addEventListener("focusin", makeCurrent);
    viewer.addEventListener("pointerenter", makeCurrent);
    // A browser may keep a moved slider over a reload.
    setSplit(split.value);
    // Large pictures come without their linear values.
    if (exposure) {
      exposure.value = "0";
      exposure.addEventListener("input", expose);
      stage.addEventListener("pointermove", read);
      stage.addEventListener("pointerleave", () => { readout.textContent = invitation; });
    }
    const controls = { flip, slide };
    return controls;
  };

  const viewers = Array.from(document.querySelectorAll(".viewer"), prepare);
  current = viewers[0] ?? null;

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !current) return;
    const key = event.key.toLowerCase();
    if (key === "f") current.flip();
    if (key === "s") current.slide();
  });

  const lightbox = document.getElementById("lightbox");
  const large = lightbox.querySelector("img");
  for (const button of document.querySelectorAll(".enlarge")) {
    button.addEventListener("click", () => {
      const small = button.querySelector("img");
      const [width, height] = [small.naturalWidth, small.naturalHeight];
      const fit = Math.min((innerWidth - 40) / width, (innerHeight - 90) / height);
      const scale = fit >= 1 ? Math.floor(fit) : fit;
      large.src = small.src;
      large.alt = small.alt;
      large.width = width * scale;
      large.height = height * scale;
      lightbox.querySelector(".lightbox-title").textContent = `${button.dataset.title}, ${+scale.toFixed(2)} times`;
      lightbox.showModal();
    });
  }
  lightbox.addEventListener("click", (event) => {
    if (event.target === lightbox || event.target === large) lightbox.close();
  });

  // A record of a scene with several is closed until something leads to it.
  const openTarget = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const record = target && target.closest("details.record");
    if (!record || record.open) return;
    record.open = true;
    target.scrollIntoView();
  };
  addEventListener("hashchange", openTarget);
  for (const link of document.querySelectorAll('a[href^="#"]')) {
    link.addEventListener("click", () => setTimeout(openTarget, 0));
  }
  openTarget();

  addEventListener("beforeprint", () => {
    // Records that stand side by side are printed as far as the reader opened them.
    for (const details of document.querySelectorAll("details:not(.record)")) details.open = true;
  });
})();
