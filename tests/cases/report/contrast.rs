//! The colors of the report's style sheet stand out, for all eyes.

type Color = [f64; 3];

fn linear(hex: &str) -> Color {
    [0, 2, 4].map(|at| {
        let value = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    })
}

fn times(matrix: [[f64; 3]; 3], color: Color) -> Color {
    matrix.map(|row| row.iter().zip(color).map(|(a, b)| a * b).sum())
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
fn oklab(color: Color) -> Color {
    let cones = times(
        [
            [0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9],
            [0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6],
            [0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5],
        ],
        color.map(|part| part.max(0.0)),
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

/// The values of a theme's variables whose names begin so.
fn values<'a>(theme: &'a str, name: &str) -> Vec<&'a str> {
    theme
        .split(name)
        .skip(1)
        .filter_map(|rest| rest.split_once('#'))
        .map(|(_, hex)| hex)
        .map(|hex| &hex[..6])
        .collect()
}

#[test]
fn colors_stand_out_and_differ_for_all_eyes() {
    let page = lodestone::lab::chart::Page::default().html();
    let themes: Vec<&str> = page.split(":root").skip(1).filter_map(|part| part.split('}').next()).collect();
    assert_eq!(themes.len(), 2);
    for theme in themes {
        let one = |name: &str| values(theme, name)[0];
        let (paper, looks) = (one("--paper"), values(theme, "--l"));
        assert_eq!(looks.len(), 8);
        assert!(contrast(one("--ink"), paper) > 12.0);
        assert!(contrast(one("--soft"), paper) > 4.5);
        for (at, look) in looks.iter().enumerate() {
            assert!(contrast(look, paper) >= 3.0, "{look} on {paper}");
            for (other, eye) in looks[..at].iter().flat_map(|other| EYES.map(|eye| (other, eye))) {
                let [a, b] = [look, other].map(|hex| oklab(times(eye, linear(hex))));
                let apart = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                assert!(apart > 0.07, "{look} and {other} are {apart} apart");
            }
        }
    }
}
