/* Search in pages opened from disk: there browsers refuse workers, so a hidden frame takes their place. */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      this.frame.srcdoc = `<script>
        postMessage = parent.postMessage.bind(parent)
        importScripts = (...urls) => urls.reduce((before, url) => before.then(() => new Promise((done, failed) => {
          const script = document.createElement("script")
          Object.assign(script, { src: url, onload: done, onerror: failed })
          document.body.appendChild(script)
        })), Promise.resolve())
      <\/script><body><script src="${new URL(url, location)}"><\/script></body>`
      document.body.appendChild(this.frame)
      this.ready = new Promise(done => this.frame.addEventListener("load", done, { once: true }))
      addEventListener("message", event => {
        if (event.source !== this.frame.contentWindow) return
        const said = new MessageEvent("message", { data: event.data })
        this.dispatchEvent(said)
        this.onmessage?.(said)
      })
    }
    postMessage(data) {
      const said = new MessageEvent("message", { data })
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(said))
    }
    terminate() {
      this.frame.remove()
    }
  }
}
