//! Colours and text styles, for pages and for charts that stand alone.

/// Paper, ink, soft ink, grid, and a colour a look. Chosen so that every colour
/// stands out from the paper by 3 to 1 at least, and any two from each other also for
/// those who see no red, no green or no blue; a test computes both.
pub(super) struct Theme {
    pub paper: &'static str,
    pub ink: &'static str,
    pub soft: &'static str,
    pub grid: &'static str,
    pub looks: [&'static str; super::shape::LOOKS],
}

pub(super) const LIGHT: Theme = Theme {
    paper: "#ffffff",
    ink: "#1b2127",
    soft: "#56616b",
    grid: "#dfe4e8",
    looks: ["#0b57d0", "#ce7c30", "#17573c", "#b8178f", "#7a5f08", "#2c94ec", "#6a1874", "#848a90"],
};

pub(super) const DARK: Theme = Theme {
    paper: "#15191e",
    ink: "#e4e8ec",
    soft: "#a0abb5",
    grid: "#313941",
    looks: ["#3f80ff", "#e39749", "#35e8c8", "#e0407c", "#fadb2e", "#63c2ff", "#9a78c4", "#a6aab0"],
};

/// The colours as variables, by what the reader prefers. Paper is light.
pub(super) fn variables() -> String {
    let of = |theme: &Theme| {
        let looks = theme.looks.iter().enumerate().map(|(at, colour)| format!("--l{at}:{colour};"));
        let Theme { paper, ink, soft, grid, .. } = theme;
        format!(
            ":root{{--paper:{paper};--ink:{ink};--soft:{soft};--grid:{grid};{}}}",
            looks.collect::<String>()
        )
    };
    let looks: String = (0..super::shape::LOOKS).map(|at| format!(".l{at}{{--c:var(--l{at})}}")).collect();
    format!("{}\n@media screen and (prefers-color-scheme:dark){{{}}}\n{looks}\n", of(&LIGHT), of(&DARK))
}

/// Of a chart that brings its own page.
pub(super) fn alone() -> String {
    format!("\n{}{CHART}", variables())
}

/// Sizes of text are those that `frame` reckons with.
pub(super) const CHART: &str = "\
.chart{--c:var(--soft)}
.chart text{font:12px system-ui,-apple-system,'Segoe UI',Roboto,Helvetica,Arial,sans-serif;fill:var(--soft);\
paint-order:stroke;stroke:var(--paper);stroke-width:3px;stroke-linejoin:round}
.chart .label,.chart .title,.chart .better{font-size:13px}
.chart .label,.chart .value{fill:var(--ink)}
.chart .title,.chart .name,.chart .heading{font-weight:600;fill:var(--ink)}
.chart .heading{font-size:15px}
.chart path,.chart circle,.chart .frame{fill:none;stroke-linejoin:round;stroke-linecap:round}
.chart .frame{stroke:var(--grid)}
.chart .grid{stroke:var(--grid)}
.chart .minor{stroke:var(--grid);stroke-width:.5;stroke-opacity:.7}
.chart .line{stroke:var(--c);stroke-width:2;stroke-linecap:butt}
.chart .join{stroke:var(--c);stroke-width:1.2}
.chart .mark{fill:var(--c);stroke:var(--paper);stroke-width:1}
.chart .off{fill-opacity:.28;stroke:var(--c)}
.chart .under{fill:var(--paper)}
.chart .ring{stroke:var(--ink);stroke-width:1.6}
.chart .was{stroke:var(--c);stroke-width:1.2}
.chart .arrow{stroke:var(--c);stroke-width:1}
.chart .leader{stroke:var(--soft);stroke-width:.7}
.chart .front{stroke:var(--soft);stroke-width:1.4;stroke-dasharray:5 3}
.chart .behind{fill:var(--soft);fill-opacity:.06}
.chart .level{stroke:var(--ink);stroke-width:1;stroke-dasharray:2 3}
.chart .bar{fill:var(--c);stroke:none}
.chart .hollow{fill:none;stroke:var(--c);stroke-width:1.2;stroke-dasharray:3 2}
.chart .halo{stroke:var(--paper);stroke-width:4;stroke-opacity:.7}
.chart .spread{stroke:var(--ink);stroke-width:1.2}
.chart .dots{stroke:var(--ink)}
.chart .marked{stroke:var(--l1)}
.paper{fill:var(--paper)}
";

/// Of the page around the charts.
pub(super) const PAGE: &str = "\
body{margin:0;background:var(--paper);color:var(--ink);\
font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,Helvetica,Arial,sans-serif}
main,footer{max-width:46rem;margin:0 auto;padding:0 1rem}
h1{font-size:1.8rem;line-height:1.2;margin:2.5rem 0 .6rem}
h2{font-size:1.35rem;margin:3rem 0 .4rem;padding-top:.8rem;border-top:1px solid var(--grid)}
.lead{font-size:1.1rem}
nav ul{display:flex;flex-wrap:wrap;gap:.2rem 1.2rem;padding:0;list-style:none}
a{color:var(--l0)}
figure{margin:2rem 0;break-inside:avoid}
h3{font-size:1rem;margin:0 0 .6rem}
.plot,.wide{overflow-x:auto}
.chart{display:block;width:100%;min-width:32rem;height:auto}
figcaption,details,footer{color:var(--soft);font-size:.9rem}
figcaption{margin:.4rem 0}
summary{cursor:pointer}
table{border-collapse:collapse;margin:.6rem 0;color:var(--ink);font-size:.875rem;font-variant-numeric:tabular-nums}
caption{text-align:left;padding:.2rem 0;color:var(--soft)}
th,td{padding:.2rem .9rem .2rem 0;border-bottom:1px solid var(--grid);text-align:left;vertical-align:baseline}
th{font-weight:500}thead th{font-weight:600}
.number{text-align:right}.number,tbody th{white-space:nowrap}
td:not(.number){min-width:8em}
.unit{display:block;font-weight:400;color:var(--soft)}
footer{margin-top:3rem;padding-bottom:3rem}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.2rem}
dt{font-weight:600}dd{margin:0;overflow-wrap:anywhere}
@media (max-width:30rem){dl{display:block}dd{margin-bottom:.4rem}}
@media print{nav,summary{display:none}.plot,.wide{overflow:visible}.chart{min-width:0}\
details::details-content{content-visibility:visible;display:block}}
";

#[cfg(test)]
mod tests {
    use super::*;

    type Colour = [f64; 3];

    fn linear(hex: &str) -> Colour {
        [1, 3, 5].map(|at| {
            let value = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
            if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        })
    }

    fn times(matrix: [[f64; 3]; 3], colour: Colour) -> Colour {
        matrix.map(|row| row.iter().zip(colour).map(|(a, b)| a * b).sum())
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let light = |hex| times([[0.2126, 0.7152, 0.0722], [0.0; 3], [0.0; 3]], linear(hex))[0] + 0.05;
        let (a, b) = (light(a), light(b));
        a.max(b) / a.min(b)
    }

    /// As one sees who has all cones, or lacks one kind (Machado, Oliveira and
    /// Fernandes 2009, complete dichromacy).
    const EYES: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    ];

    /// A space where distances are about as large as they look (Ottosson 2020).
    fn oklab(colour: Colour) -> Colour {
        let cones = times(
            [
                [0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9],
                [0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6],
                [0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5],
            ],
            colour.map(|part| part.max(0.0)),
        );
        times(
            [
                [0.210_454_255_3, 0.793_617_785, -0.004_072_046_8],
                [1.977_998_495_1, -2.428_592_205, 0.450_593_709_9],
                [0.025_904_037_1, 0.782_771_766_2, -0.808_675_766],
            ],
            cones.map(f64::cbrt),
        )
    }

    #[test]
    fn colours_stand_out_and_differ_for_all_eyes() {
        for theme in [&LIGHT, &DARK] {
            assert!(contrast(theme.ink, theme.paper) > 12.0);
            assert!(contrast(theme.soft, theme.paper) > 4.5);
            for (at, look) in theme.looks.iter().enumerate() {
                assert!(contrast(look, theme.paper) >= 3.0, "{look} on {}", theme.paper);
                for (other, eye) in theme.looks[..at].iter().flat_map(|other| EYES.map(|eye| (other, eye))) {
                    let [a, b] = [look, other].map(|hex| oklab(times(eye, linear(hex))));
                    let apart = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                    assert!(apart > 0.07, "{look} and {other} are {apart} apart");
                }
            }
        }
    }
}
