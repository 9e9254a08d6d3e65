//! The EPSG data set, as the crate `crs-definitions` has it: WKT 1 and proj4, both
//! with datum shifts.

/// The proj4 string of a system.
pub fn proj4(code: u16) -> Option<&'static str> {
    crs_definitions::from_code(code).map(|definition| definition.proj4).filter(|text| text.contains("+proj="))
}

/// The WKT of a system.
pub fn wkt(code: u16) -> Option<&'static str> {
    crs_definitions::from_code(code).map(|definition| definition.wkt).filter(|text| text.contains('['))
}

/// Codes of geographic systems: the range of old, and that of the newer ones.
const GEOGRAPHIC: [std::ops::RangeInclusive<u16>; 2] = [4001..=5600, 6000..=10_999];

/// The geographic system whose datum is called so, as a proj4 string; how it is
/// spelled does not matter, nor does ESRI's `D_` in front.
pub fn proj4_of_datum(name: &str) -> Option<&'static str> {
    let name = bare(name);
    GEOGRAPHIC.into_iter().flatten().filter_map(crs_definitions::from_code).find_map(|definition| {
        let is_it = definition.proj4.starts_with("+proj=longlat")
            && datum(definition.wkt).map(bare).as_ref() == Some(&name);
        is_it.then_some(definition.proj4)
    })
}

/// The name of the datum in a WKT 1.
fn datum(wkt: &str) -> Option<&str> {
    let (_, after) = wkt.split_once("DATUM[\"")?;
    after.split_once('"').map(|(name, _)| name)
}

/// A datum's name without what writers differ in.
fn bare(name: &str) -> String {
    let name = name.strip_prefix("D_").unwrap_or(name);
    let name: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
    match name.to_ascii_lowercase().as_str() {
        "wgs84" => "wgs1984",
        "nad27" | "northamerican1927" => "northamericandatum1927",
        "nad83" | "northamerican1983" => "northamericandatum1983",
        other => return other.to_string(),
    }
    .to_string()
}
