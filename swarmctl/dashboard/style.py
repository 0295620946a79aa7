"""The style sheets of the pages."""

COMMON = """
body { --q-primary: #1565a9 !important } body.body--dark { --q-primary: #6aaef0 !important }
body { --note: #8a4500 } body.body--dark { --note: #ffb74d }
a, canvas, .card-vehicle { outline: none }
:is(.q-btn, .q-checkbox, a):focus-visible { box-shadow: 0 0 0 2px var(--q-primary) }
:is(.q-tab, .card-vehicle, canvas):focus-visible { box-shadow: inset 0 0 0 2px var(--q-primary) }
.q-notifications__list--bottom { bottom: 52px }
.note { color: var(--note) }
"""
"""controls, their focus and the notices, of all pages"""

RUNS = """
body { overflow: hidden }
.nicegui-content { padding: 0; gap: 0; height: 100vh; flex-wrap: nowrap }
.risk-map { width: 100%; height: 100%; position: relative }
.risk-map canvas { display: block; touch-action: none }
.unheard { position: absolute; top: 8px; left: 8px; right: 8px; padding: 6px 12px; border-radius: 6px }
.unheard { background: #a00000; color: #fff; font-weight: 600; text-align: center }
.is-old .run-side, .is-old canvas { opacity: .45 }
.card-vehicle { border-left: 6px solid var(--colour); border-radius: 6px; padding: 8px 10px; width: 100% }
.card-vehicle .facts { font-variant-numeric: tabular-nums; font-size: 12px; line-height: 1.5; opacity: .85 }
.alarms { background: rgba(200, 0, 0, .1); border-left: 6px solid #c00; flex: none; gap: 0; padding: 2px 8px }
.is-silent { opacity: .55 }
.runs { width: 100%; flex: 1 1 0; min-height: 0; display: grid }
.runs { grid-auto-columns: minmax(0, 1fr); grid-auto-flow: column }
.run { display: flex; min-width: 0; min-height: 0 } .run-map { flex: 1 1 0; min-width: 0; min-height: 0 }
.run-side { flex: 0 0 360px; width: 360px; min-width: 0; min-height: 0; flex-wrap: nowrap }
.is-double .run { flex-direction: column; border-left: 1px solid rgba(128, 128, 128, .4) }
.run-head { flex: none } .source { flex: 1 1 4em; min-width: 0 } .speed { flex: none; width: 4.5rem }
.is-double .run-side { flex: 0 0 38%; width: 100% }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(300px, 1fr)); align-content: start }
.cards > .orders { grid-column: 1 / -1 }
.sliders { display: grid; grid-template-columns: repeat(auto-fit, minmax(300px, 1fr)); gap: 0 24px }
.sliders { width: 100% }
.fields { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 8px; width: 100% }
.time { flex: 1 1 0; position: relative }
.time svg { position: absolute; top: -5px; width: 100%; height: 12px; pointer-events: none }
.alarm { fill: #d52b1e } .warning { fill: #e69f00 } .change { fill: #808080 }
@media (max-width: 1000px) {
  .head { gap: 4px; flex-wrap: nowrap } .head .q-field { min-width: 7rem; flex: 0 1 9rem }
  .head .source { flex-shrink: 9 }
  .head .q-checkbox__label { font-size: 12px; white-space: nowrap }
  .head .q-checkbox__inner { font-size: 28px }
  .run { flex-direction: column } .run-side { flex: 0 0 36%; width: 100% }
}
"""
"""maps with cards and lists, of a run and of the set-up"""
