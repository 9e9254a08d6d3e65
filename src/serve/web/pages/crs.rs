//! What a coordinate system's text (WKT) tells a person: its name, and in what it
//! counts. No more is needed here; `format::crs` reads it in earnest.

use serde_json::Value;

/// What a coordinate system is called, by its WKT: the projection's name rather than
/// that of the compound it is part of, and its heights'.
pub(super) fn name(wkt: &str) -> Option<String> {
    const KINDS: [&str; 9] =
        ["PROJCS", "PROJCRS", "GEOGCS", "GEOGCRS", "GEODCRS", "GEOCCS", "LOCAL_CS", "ENGCRS", "COMPD_CS"];
    let name_of = |kind: &str| {
        let (_, rest) = wkt.split_once(&format!("{kind}[\""))?;
        let name = rest.split('"').next()?.trim();
        (!matches!(name, "" | "unknown" | "unnamed")).then(|| name.replace('_', " "))
    };
    let base = KINDS.iter().find_map(|kind| name_of(kind));
    let geocentric =
        || wkt.contains("GEOCCS[").then(|| name_of("DATUM").map(|datum| format!("geocentric, {datum}")))?;
    let base = base.or_else(geocentric);
    let base = base.or_else(|| (wkt.len() < 60 && !wkt.trim().is_empty()).then(|| wkt.to_string()))?;
    match name_of("VERT_CS").or_else(|| name_of("VERTCRS")) {
        Some(heights) => Some(format!("{base}, heights in {heights}")),
        None => Some(base),
    }
}

/// The whole text in a conversion's report; older ones have it as their projection.
pub(super) fn of(report: &Value) -> &str {
    let text = |key: &str| report[key].as_str().filter(|text| !text.is_empty());
    text("crs").or_else(|| text("projection")).unwrap_or("")
}

/// In what its coordinates count: across, and for heights. Nothing where the text
/// does not tell.
pub(super) fn units(wkt: &str) -> Option<[&'static str; 2]> {
    let projected = within(wkt, &["PROJCS", "PROJCRS", "GEOCCS"]);
    let across = match projected {
        Some(system) => short(&unit_of(system)?),
        None => within(wkt, &["GEOGCS", "GEOGCRS", "GEODCRS"]).map(|_| "°")?,
    };
    let heights = within(wkt, &["VERT_CS", "VERTCRS"]).and_then(unit_of);
    // Without a system of their own, heights count as the rest; of degrees nobody knows.
    let own = if projected.is_some() { across } else { "" };
    Some([across, heights.map_or(own, |name| short(&name))])
}

/// What stands between the brackets of the first of these words.
fn within<'a>(wkt: &'a str, words: &[&str]) -> Option<&'a str> {
    let start = words.iter().find_map(|word| {
        let open = format!("{word}[");
        wkt.find(&open).map(|at| at + open.len())
    })?;
    let (mut depth, mut quoted) = (1, false);
    let end = wkt[start..].find(|c| {
        match c {
            '"' => quoted = !quoted,
            '[' if !quoted => depth += 1,
            ']' if !quoted => depth -= 1,
            _ => {}
        }
        depth == 0
    });
    Some(&wkt[start..end.map_or(wkt.len(), |end| start + end)])
}

/// The name of a system's own unit of length: the last one, for those of what it is
/// based on stand before it.
fn unit_of(system: &str) -> Option<String> {
    let at =
        ["LENGTHUNIT[\"", ",UNIT[\""].iter().find_map(|word| system.rfind(word).map(|at| at + word.len()))?;
    Some(system[at..].split('"').next()?.to_ascii_lowercase().replace('_', " "))
}

fn short(unit: &str) -> &'static str {
    match unit {
        "m" | "metre" | "meter" | "metres" | "meters" => "m",
        _ if unit.contains("us")
            && (unit.contains("foot") || unit.contains("feet") || unit.contains("ft")) =>
        {
            "US ft"
        }
        _ if unit.contains("foot") || unit.contains("feet") || unit == "ft" => "ft",
        "kilometre" | "kilometer" | "km" => "km",
        "degree" | "degrees" => "°",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_report_tells_of_its_system() {
        for (report, text) in [
            (json!({"crs": "WKT", "projection": "+proj=x"}), "WKT"),
            (json!({"crs": "", "projection": "old WKT"}), "old WKT"),
            (json!({"projection": ""}), ""),
            (json!(null), ""),
        ] {
            assert_eq!(of(&report), text);
        }
    }

    #[test]
    fn coordinate_systems_are_called_by_their_projection() {
        for (wkt, name) in [
            (
                r#"COMPD_CS["unknown",PROJCS["NAD83 / BC Albers",GEOGCS["NAD83",D]],VERT_CS["CGVD28",V]]"#,
                Some("NAD83 / BC Albers, heights in CGVD28"),
            ),
            (r#"PROJCS["WGS_1984_UTM_Zone_32N",GEOGCS["x"]]"#, Some("WGS 1984 UTM Zone 32N")),
            (r#"GEOGCS["WGS 84",DATUM["x"]]"#, Some("WGS 84")),
            (r#"GEOCCS["unnamed",DATUM["WGS_1984",S],UNIT["metre",1]]"#, Some("geocentric, WGS 1984")),
            ("EPSG:25832", Some("EPSG:25832")),
            ("", None),
        ] {
            assert_eq!(super::name(wkt).as_deref(), name);
        }
    }

    #[test]
    fn coordinates_count_in_what_the_text_says() {
        let metre = r#"PROJCS["UTM",GEOGCS["WGS 84",UNIT["degree",0.01]],PROJECTION["TM"],UNIT["metre",1],AUTHORITY["EPSG","1"]]"#;
        let feet = metre.replace("metre", "US survey foot");
        let wkt2 = r#"PROJCRS["x",BASEGEOGCRS["y",ANGLEUNIT["degree",0.01]],CS[Cartesian,2],AXIS["E",east],LENGTHUNIT["foot",0.3048]]"#;
        let compound =
            format!(r#"COMPD_CS["a ] b",{feet},VERT_CS["NAVD88",VERT_DATUM["d",2005],UNIT["metre",1]]]"#);
        for (wkt, units) in [
            (metre, Some(["m", "m"])),
            (feet.as_str(), Some(["US ft", "US ft"])),
            (wkt2, Some(["ft", "ft"])),
            (compound.as_str(), Some(["US ft", "m"])),
            (r#"GEOGCS["WGS 84",DATUM["x"],UNIT["degree",0.01]]"#, Some(["°", ""])),
            (r#"GEOCCS["x",DATUM["y"],UNIT["metre",1]]"#, Some(["m", "m"])),
            ("EPSG:25832", None),
            (r#"PROJCS["cut"#, None),
            ("", None),
        ] {
            assert_eq!(super::units(wkt), units, "{wkt}");
        }
    }
}
