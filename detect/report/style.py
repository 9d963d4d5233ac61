"""How the page looks, on a screen and on paper."""

STYLE = """
:root{--ink:#1b1f24;--soft:#5b6470;--line:#d9dee4;--paper:#fff;--wash:#f5f7f9}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,
"Helvetica Neue",Arial,sans-serif}
main{max-width:1060px;margin:0 auto;padding:40px 28px 60px}
h1{font-size:30px;line-height:1.2;margin:0 0 4px;letter-spacing:-.01em}
h2{font-size:20px;margin:44px 0 10px;padding-top:14px;border-top:1px solid var(--line)}
h3{font-size:16px;margin:24px 0 6px}
p{max-width:78ch;margin:8px 0}
.sub,.foot,figcaption,.small{color:var(--soft);font-size:14px}
.lead{font-size:18.5px;max-width:72ch;margin:18px 0 8px}
.facts{display:flex;flex-wrap:wrap;gap:0;margin:22px 0 6px;border:1px solid var(--line);border-radius:8px}
.facts div{padding:11px 20px;border-right:1px solid var(--line);flex:1 1 auto}
.facts div:last-child{border-right:0}
.facts b{display:block;font-size:20px;font-weight:650;font-variant-numeric:tabular-nums}
.facts span{color:var(--soft);font-size:13px}
.note{background:#fff8e6;border-left:4px solid #b8860b;padding:9px 15px;margin:12px 0;max-width:none;font-size:15px}
.note ul{margin:0;padding-left:18px}
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(380px,1fr));gap:26px}.pair figure{max-width:620px}
figure{margin:14px 0;break-inside:avoid}
figure svg{width:100%;height:auto;display:block}
svg text{font-family:system-ui,-apple-system,"Segoe UI",Roboto,Arial,sans-serif}
svg text:not([font-size]){font-size:13px}svg text:not([fill]){fill:#444}
svg text.name{font-size:14px;fill:#1b1f24}
sup{font-size:.72em;line-height:0;vertical-align:.45em}
.look{display:grid;grid-template-columns:minmax(0,7fr) minmax(0,5fr);gap:24px;align-items:start}
.scene{display:block;width:100%;height:auto;border:1px solid var(--line)}
.scene text{font-weight:700;fill:#fff;stroke:#000;paint-order:stroke;stroke-linejoin:round}
.scene circle{fill:none;vector-effect:non-scaling-stroke}
.halo{stroke:#000;stroke-opacity:.6;stroke-width:4.5}.ring{stroke:#ff8c42;stroke-width:2.2}
.legend{display:flex;flex-wrap:wrap;gap:4px 22px;font-size:15px;margin:4px 0 8px 60px}
svg.key{width:34px;height:10px;margin-right:8px;vertical-align:middle;display:inline-block;flex:none}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:15px;font-variant-numeric:tabular-nums;margin:10px 0;width:100%}
th,td{padding:6px 12px 6px 0;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap;vertical-align:top}
th{font-weight:600;color:var(--soft);font-size:13px;border-bottom:1.5px solid #9aa3ad;vertical-align:bottom}
.who{white-space:normal;display:inline-block;max-width:12em;overflow-wrap:anywhere}
th:first-child,td:first-child{text-align:left;white-space:normal;overflow-wrap:anywhere;min-width:8em}
small.in{color:var(--soft);font-size:13.5px;display:inline-block;min-width:5.2em;text-align:right}
td small:not(.in){color:var(--soft);font-size:13px;display:block;line-height:1.25}
.chips{display:grid;grid-template-columns:repeat(auto-fill,minmax(104px,1fr));gap:14px 12px;margin:14px 0}
.chips figure{margin:0}
.chip{image-rendering:pixelated;border:1px solid var(--line);aspect-ratio:1}
.chips figcaption{font-size:12.5px;line-height:1.3;margin-top:4px}
.bar{display:inline-flex;align-items:center;gap:8px;font-size:13px;color:var(--soft);margin-left:6px}
dl{display:grid;grid-template-columns:max-content 1fr;gap:3px 18px;font-size:14px;margin:10px 0}
dt{color:var(--soft)}dd{margin:0;overflow-wrap:anywhere}
code{font:13px ui-monospace,Menlo,Consolas,monospace;overflow-wrap:anywhere}
@media print{body{font-size:11pt}main{max-width:none;padding:0}h2,h3{break-after:avoid}
.look,.chips figure{break-inside:avoid}
tr,.facts,.note{break-inside:avoid}
.scroll{overflow:visible}*{-webkit-print-color-adjust:exact;print-color-adjust:exact}@page{margin:16mm}}
@media(max-width:560px){main{padding:22px 14px}.pair,.look{grid-template-columns:1fr}.legend{margin-left:0}}
"""
