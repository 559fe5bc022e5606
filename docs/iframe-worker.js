// The search runs in a worker, and Chromium starts none from a file: for a page that is opened as one, a frame of the page does it.
if (location.protocol === "file:") {
  window.Worker = class {
    constructor(url) {
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inside = this.frame.contentWindow;
      inside.postMessage = (message) => {
        const data = structuredClone(message); // as of now: neither side sees what the other does to it later
        setTimeout(() => this.onmessage?.({ data }));
      };
      const script = inside.document.createElement("script");
      script.src = url;
      this.loaded = new Promise((resolve) => (script.onload = resolve));
      inside.document.body.append(script);
    }
    async postMessage(message) {
      const data = structuredClone(message);
      await this.loaded;
      this.frame.contentWindow.onmessage?.({ data });
    }
    terminate() {
      this.frame.remove();
    }
  };
}
