//! From WKT to a proj4 string. What the text itself says comes first; the EPSG
//! data set gives what it leaves to its codes, above all datum shifts.

use std::fmt::Write;

use super::epsg;
use super::horizontal::{horizontal, is_geocentric};
use super::methods::{self, ParameterKind, ProjectionMethod};
use super::wkt::{self, WktNode, WktValue};

/// Radians of a degree.
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Meters of an international foot, and of one of the US survey.
const FOOT: f64 = 0.3048;
const SURVEY_FOOT: f64 = 1200.0 / 3937.0;

/// The horizontal part of a system.
pub fn of_wkt(root: &WktNode) -> Option<String> {
    let node = horizontal(root)?;
    let known = node.epsg().and_then(epsg::proj4).map(for_viewers);
    // A text may name a system and count in other units than that has.
    let unit = linear_unit(node);
    if let Some(known) = known
        && (unit.is_none() || node.is(wkt::GEODETIC) || is_close(unit.unwrap_or(1.0), unit_of(&known)))
    {
        return Some(known);
    }
    if is_geocentric(node) {
        let unit = linear_unit(node).unwrap_or(1.0);
        return Some(format!("+proj=geocent {} {} +no_defs", datum(node)?, unit_text(unit)));
    }
    match node.is(wkt::GEODETIC) {
        true => Some(format!("+proj=longlat {} +no_defs", datum(node)?)),
        false => projected(node),
    }
}

fn is_close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-8 * b.abs()
}

fn projected(node: &WktNode) -> Option<String> {
    let base = node.child(wkt::GEODETIC)?;
    let conversion = node.child(&["CONVERSION"]);
    let method_name = conversion.unwrap_or(node).child(wkt::METHOD)?.name();
    let method = methods::method_of(method_name)?;
    let unit = linear_unit(node).unwrap_or(1.0);
    let datum = match method.proj4 {
        methods::WEB_MERCATOR => String::new(),
        _ => datum(base)?,
    };
    let mut values: Vec<(&str, f64)> = Vec::new();
    for parameter in conversion.unwrap_or(node).children().filter(|n| n.is(&["PARAMETER"])) {
        let Some((name, kind)) = methods::parameter_of(parameter.name()) else { continue };
        let value = parameter.numbers().next()?;
        let own = parameter.child(&["ANGLEUNIT", "LENGTHUNIT", "SCALEUNIT", "UNIT"]).and_then(factor);
        let value = match kind {
            ParameterKind::Angle => value * own.map_or_else(|| angular_unit(base), |own| own / DEGREE),
            ParameterKind::Length => value * own.unwrap_or(unit),
            ParameterKind::Scale => value,
        };
        values.push((name, value));
    }
    let mut text = method.proj4.to_string();
    for (name, value) in renamed(&values, method, method_name) {
        let _ = write!(text, " +{name}={}", rounded(value));
    }
    let text = [text, datum, unit_text(unit)].join(" ");
    Some(format!("{} +no_defs", text.split_whitespace().collect::<Vec<_>>().join(" ")))
}

/// Parameters whose meaning hangs on the method.
fn renamed<'v>(values: &[(&'v str, f64)], method: ProjectionMethod, name: &str) -> Vec<(&'v str, f64)> {
    let get = |wanted: &str| values.iter().find(|(name, _)| *name == wanted).map(|(_, value)| *value);
    let name = methods::bare(name);
    let mut values = values.to_vec();
    let is_oblique = method.proj4.starts_with("+proj=omerc");
    match method.latitude {
        // One standard parallel, or a scale at the equator; never a latitude of origin.
        "" => {
            for value in &mut values {
                if value.0 == "lat_1" {
                    value.0 = "lat_ts";
                }
            }
            values.retain(|(name, _)| *name != "lat_0" && *name != "lat_2");
        }
        // The pole is where the latitude of origin, or of true scale, is nearest to.
        "polar" => {
            let given = get("lat_ts").or(get("lat_1")).or(get("lat_0")).unwrap_or(90.0);
            let pole = 90f64.copysign(given);
            values.retain(|(name, _)| !matches!(*name, "lat_0" | "lat_1" | "lat_ts"));
            values.insert(0, ("lat_0", pole));
            if given != pole {
                values.insert(1, ("lat_ts", given));
            }
        }
        // With one standard parallel it is the latitude of origin, at which the scale holds.
        _ if method.proj4 == "+proj=lcc" && get("lat_1").is_none() => {
            values.insert(0, ("lat_1", get("lat_0").unwrap_or(0.0)));
        }
        _ if method.proj4 == "+proj=eqc" => {
            for value in &mut values {
                if value.0 == "lat_1" {
                    value.0 = "lat_ts";
                }
            }
        }
        _ => {}
    }
    if is_oblique {
        for value in &mut values {
            if value.0 == "lon_0" {
                value.0 = "lonc";
            }
        }
        // Swiss grids are written so; proj4 has them apart.
        if name != "hotineobliquemercator"
            && get("alpha") == Some(90.0)
            && get("gamma").is_none_or(|g| g == 90.0)
        {
            values.retain(|(name, _)| !matches!(*name, "alpha" | "gamma"));
        }
    }
    values
}

/// A number without what its conversion left behind the thirteenth digit.
fn rounded(value: f64) -> f64 {
    format!("{value:.12e}").parse().unwrap_or(value)
}

/// Has a projected system count in another unit: its lengths are converted, and it
/// is no longer the one of its code. False where it counts in that already.
pub fn count_in(node: &mut WktNode, name: &str, meters: f64) -> bool {
    let Some(now) = linear_unit(node).filter(|now| node.is(wkt::PROJECTED) && !is_close(*now, meters)) else {
        return false;
    };
    let is_length =
        |n: &WktNode| methods::parameter_of(n.name()).is_some_and(|(_, kind)| kind == ParameterKind::Length);
    for value in &mut node.values {
        let WktValue::Node(child) = value else { continue };
        if child.is(&["UNIT"]) {
            child.values = vec![WktValue::Text(name.to_string()), WktValue::Number(meters)];
        } else if child.is(&["PARAMETER"]) && is_length(child) {
            for value in &mut child.values {
                if let WktValue::Number(number) = value {
                    *number = *number * now / meters;
                }
            }
        }
    }
    node.values.retain(|value| !matches!(value, WktValue::Node(child) if child.is(wkt::CODE)));
    true
}

/// The factor of a unit, to meters or radians.
fn factor(unit: &WktNode) -> Option<f64> {
    unit.numbers().next().filter(|factor| *factor > 0.0)
}

/// Meters of the unit in which a system counts.
fn linear_unit(node: &WktNode) -> Option<f64> {
    let own = node.child(&["UNIT", "LENGTHUNIT"]);
    let of_axis =
        || node.children().filter(|n| n.is(&["AXIS"])).find_map(|axis| axis.child(&["LENGTHUNIT", "UNIT"]));
    own.or_else(of_axis).and_then(factor)
}

/// Degrees of the unit of a geodetic system's angles. Writers name meters there;
/// those mean degrees.
fn angular_unit(base: &WktNode) -> f64 {
    let unit = base.child(&["UNIT", "ANGLEUNIT"]).filter(|unit| {
        let name = unit.name().to_ascii_lowercase();
        ["deg", "gra", "gon", "rad"].iter().any(|start| name.starts_with(start))
    });
    // A degree as 0.017453292519943 is still one.
    let degrees = unit.and_then(factor).unwrap_or(DEGREE) / DEGREE;
    if (degrees - 1.0).abs() < 1e-9 { 1.0 } else { degrees }
}

fn unit_text(meters: f64) -> String {
    match meters {
        m if is_close(m, 1.0) => "+units=m".to_string(),
        m if is_close(m, FOOT) => "+units=ft".to_string(),
        m if is_close(m, SURVEY_FOOT) => "+units=us-ft".to_string(),
        m => format!("+to_meter={m}"),
    }
}

/// Meters of the unit of a proj4 string.
fn unit_of(proj4: &str) -> f64 {
    let value = |key: &str| proj4.split_whitespace().find_map(|token| token.strip_prefix(key));
    match (value("+to_meter="), value("+units=")) {
        (Some(meters), _) => meters.parse().unwrap_or(1.0),
        (_, Some("ft")) => FOOT,
        (_, Some("us-ft")) => SURVEY_FOOT,
        _ => 1.0,
    }
}

/// Ellipsoid, shift to WGS 84 and prime meridian of a geodetic system; nothing
/// where an old ellipsoid comes without a shift, for that would be off by hundreds
/// of meters.
fn datum(base: &WktNode) -> Option<String> {
    let datum = base.child(wkt::DATUM)?;
    let ellipsoid = datum.child(wkt::ELLIPSOID)?;
    let mut numbers = ellipsoid.numbers();
    let axis = numbers.next()? * ellipsoid.child(&["LENGTHUNIT", "UNIT"]).and_then(factor).unwrap_or(1.0);
    let flattening = numbers.next()?;
    let is_modern = (axis - 6_378_137.0).abs() < 1.0 && (flattening - 298.257).abs() < 0.001;
    let figure = match flattening {
        0.0 => format!("+a={axis} +b={axis}"),
        _ if !is_modern => format!("+a={axis} +rf={flattening}"),
        _ if (flattening - 298.257_223_563).abs() < 1e-6 => "+ellps=WGS84".to_string(),
        _ => "+ellps=GRS80".to_string(),
    };
    let own_shift = datum.child(&["TOWGS84"]).map(|shift| {
        let numbers: Vec<String> = shift.numbers().map(|number| number.to_string()).collect();
        format!("{figure} +towgs84={}", numbers.join(","))
    });
    let text = own_shift
        .or_else(|| known_datum(base, datum))
        .or_else(|| is_modern.then(|| format!("{figure} +towgs84=0,0,0,0,0,0,0")))?;
    let meridian = base.child(wkt::PRIME_MERIDIAN).and_then(|meridian| {
        let degrees = meridian.child(&["ANGLEUNIT"]).and_then(factor).map_or(1.0, |own| own / DEGREE);
        meridian.numbers().next().map(|longitude| longitude * degrees)
    });
    Some(match meridian {
        Some(longitude) if longitude != 0.0 => format!("{text} +pm={}", rounded(longitude)),
        _ => text,
    })
}

/// The datum as the EPSG data set has it, by the system's code or the datum's name,
/// if that knows a shift.
fn known_datum(base: &WktNode, datum: &WktNode) -> Option<String> {
    let known = base.epsg().and_then(epsg::proj4).or_else(|| epsg::proj4_of_datum(datum.name()))?;
    let known = for_viewers(known);
    let is_datum = |token: &&str| {
        ["+datum=", "+ellps=", "+a=", "+b=", "+rf=", "+towgs84="].iter().any(|key| token.starts_with(key))
    };
    let tokens: Vec<&str> = known.split_whitespace().filter(is_datum).collect();
    let has_shift = tokens.iter().any(|token| token.starts_with("+datum=") || token.starts_with("+towgs84="));
    has_shift.then(|| tokens.join(" "))
}

/// Datums with a name in proj4: their ellipsoid, and that with the shift that PROJ
/// has for them. The viewers' proj4.js has coarser ones. Only NAD27 has no one shift
/// but grids: the mean of the United States is right to some ten meters.
const DATUMS: [(&str, &str, &str); 8] = [
    ("GGRS87", "+ellps=GRS80", "+ellps=GRS80 +towgs84=-199.87,74.79,246.62"),
    ("NAD27", "+ellps=clrk66", "+ellps=clrk66 +towgs84=-8,160,176"),
    ("OSGB36", "+ellps=airy", "+ellps=airy +towgs84=446.448,-125.157,542.06,0.1502,0.247,0.8421,-20.4894"),
    ("carthage", "+a=6378249.2 +b=6356515", "+a=6378249.2 +b=6356515 +towgs84=-263,6,431"),
    (
        "hermannskogel",
        "+ellps=bessel",
        "+ellps=bessel +towgs84=577.326,90.129,463.919,5.137,1.474,5.297,2.4232",
    ),
    (
        "ire65",
        "+ellps=mod_airy",
        "+ellps=mod_airy +towgs84=482.53,-130.596,564.557,-1.042,-0.214,-0.631,8.15",
    ),
    ("nzgd49", "+ellps=intl", "+ellps=intl +towgs84=59.47,-5.04,187.44,0.47,-0.1,1.024,-4.5993"),
    ("potsdam", "+ellps=bessel", "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7"),
];

/// A proj4 string of the EPSG data set, or of a person, as the proj4.js of viewers
/// takes it: without heights, without grids, which it does not load, and with units
/// that it knows.
pub fn for_viewers(text: &str) -> String {
    let has_shift = text.contains("+towgs84=");
    let tokens =
        text.split_whitespace().filter_map(|token| match token.split_once('=').unwrap_or((token, "")) {
            ("+vunits" | "+vto_meter" | "+geoidgrids" | "+wktext" | "+guam", _) => None,
            ("+nadgrids", grids) if grids != "@null" => None,
            ("+datum", name) => Some(match DATUMS.iter().find(|(known, ..)| *known == name) {
                Some((_, figure, _)) if has_shift => figure,
                Some((.., whole)) => whole,
                None => token,
            }),
            ("+units", "link") => Some("+to_meter=0.201168"),
            _ => Some(token),
        });
    tokens.collect::<Vec<_>>().join(" ")
}
