//! Where on Earth the coordinates are: WKT if the file has it, otherwise what
//! its GeoTIFF keys say (LAS 1.4 R15, section 2.6; OGC GeoTIFF 1.1, annex B).
//!
//! The result is what viewers put into proj4: WKT, or a proj4 string for the
//! systems that most clouds use, or `EPSG:n`, or at least the citation.

use super::vlr::Vlr;

const PROJECTION: &str = "LASF_Projection";

/// A coordinate reference system in words that viewers read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crs {
    pub text: String,
    pub source: CrsSource,
}

/// Which of the places that a file has for it the CRS was found in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrsSource {
    Wkt,
    GeoKeys,
}

impl CrsSource {
    pub fn name(self) -> &'static str {
        match self {
            CrsSource::Wkt => "WKT",
            CrsSource::GeoKeys => "GeoTIFF keys",
        }
    }
}

/// Finds the CRS in a file's records. WKT comes first, since it says more; a
/// file may have both, and either may be empty.
pub fn find(records: &[Vlr], notes: &mut Vec<String>) -> Option<Crs> {
    let wkt = records
        .iter()
        .filter(|r| r.id == 2112 && (r.is(PROJECTION, 2112) || r.is("liblas", 2112)))
        .find_map(|r| wkt(&r.data));
    if let Some(text) = wkt {
        return Some(Crs { text, source: CrsSource::Wkt });
    }
    if records.iter().any(|r| r.id == 2112) {
        notes.push("its WKT record is empty".to_string());
    }
    let find = |id| records.iter().find(|r| r.is(PROJECTION, id)).map(|r| r.data.as_slice());
    let directory = find(34735)?;
    let keys = GeoKeys::parse(directory, find(34737).unwrap_or_default());
    match keys.describe() {
        Some(text) => Some(Crs { text, source: CrsSource::GeoKeys }),
        None => {
            notes.push("its GeoTIFF keys name no coordinate reference system".to_string());
            None
        }
    }
}

/// The records that a CRS is found in, to be written as they are: the first of
/// each kind.
pub fn records(records: Vec<Vlr>) -> Vec<Vlr> {
    let mut found: Vec<Vlr> = Vec::new();
    for record in records.into_iter().filter(Vlr::is_of_crs) {
        if found.iter().all(|other| other.id != record.id) {
            found.push(record);
        }
    }
    found
}

/// The text of a WKT record, unless it is empty or no WKT at all.
fn wkt(data: &[u8]) -> Option<String> {
    let text = super::vlr::text(data);
    (text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.contains('[')).then_some(text)
}

/// Key numbers of the GeoTIFF standard.
const CITATION: u16 = 1026;
const GEODETIC_CRS: u16 = 2048;
const GEODETIC_CITATION: u16 = 2049;
const PROJECTED_CRS: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const LINEAR_UNITS: u16 = 3076;
const ASCII_PARAMETERS: u16 = 34737;

#[derive(Debug, Default)]
struct GeoKeys {
    /// Key and value, of the keys whose value is a number.
    numbers: Vec<(u16, u16)>,
    texts: Vec<(u16, String)>,
}

impl GeoKeys {
    fn parse(directory: &[u8], ascii: &[u8]) -> GeoKeys {
        let words: Vec<u16> = directory.chunks_exact(2).map(|w| u16::from_le_bytes([w[0], w[1]])).collect();
        let mut keys = GeoKeys::default();
        // The first four words are versions and the count of keys; a count
        // that lies does not matter, since the record's length ends the list.
        let said = words.get(3).copied().unwrap_or(0);
        for entry in words.chunks_exact(4).skip(1).take(usize::from(said)) {
            let [key, location, count, value] = [entry[0], entry[1], entry[2], entry[3]];
            if location == 0 {
                keys.numbers.push((key, value));
            } else if location == ASCII_PARAMETERS {
                let start = usize::from(value).min(ascii.len());
                let end = (start + usize::from(count)).min(ascii.len());
                let text = super::vlr::text(&ascii[start..end]);
                keys.texts.push((key, text.trim_end_matches('|').to_string()));
            }
        }
        keys
    }

    fn number(&self, key: u16) -> Option<u16> {
        self.numbers.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }

    /// An EPSG code; 0 means left out and 32767 means user-defined.
    fn code(&self, key: u16) -> Option<u16> {
        self.number(key).filter(|code| (1024..32767).contains(code))
    }

    fn describe(&self) -> Option<String> {
        let named = |code: u16| proj4(code).unwrap_or_else(|| format!("EPSG:{code}"));
        if let Some(code) = self.code(PROJECTED_CRS) {
            return Some(self.in_its_units(named(code)));
        }
        let citation = |keys: &[u16]| {
            keys.iter().find_map(|key| {
                self.texts.iter().find(|(k, text)| k == key && !text.is_empty()).map(|(_, text)| text.clone())
            })
        };
        // A user-defined projection on a known datum is not that datum's
        // degrees; its citation is the truth then.
        if self.number(PROJECTED_CRS).is_some_and(|code| code != 0) {
            return citation(&[PROJECTED_CITATION, CITATION, GEODETIC_CITATION]);
        }
        match self.code(GEODETIC_CRS) {
            Some(code) => Some(named(code)),
            None => citation(&[CITATION, GEODETIC_CITATION, PROJECTED_CITATION]),
        }
    }

    /// A metric system whose file says that it counts in feet.
    fn in_its_units(&self, text: String) -> String {
        match self.number(LINEAR_UNITS) {
            Some(9002) => text.replace("+units=m", "+units=ft"),
            Some(9003) => text.replace("+units=m", "+units=us-ft"),
            _ => text,
        }
    }
}

/// The proj4 string of an EPSG code, for the families most clouds are in.
fn proj4(code: u16) -> Option<String> {
    let utm = |zone: u16, rest: &str| Some(format!("+proj=utm +zone={zone} {rest} +units=m +no_defs"));
    const GRS80: &str = "+ellps=GRS80 +towgs84=0,0,0,0,0,0,0";
    match code {
        4326 => Some("+proj=longlat +datum=WGS84 +no_defs".to_string()),
        4269 => Some("+proj=longlat +datum=NAD83 +no_defs".to_string()),
        4258 => Some("+proj=longlat +ellps=GRS80 +no_defs".to_string()),
        4978 => Some("+proj=geocent +datum=WGS84 +units=m +no_defs".to_string()),
        3857 | 3785 => Some(
            "+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 +x_0=0 +y_0=0 +k=1 +units=m +nadgrids=@null +no_defs"
                .to_string(),
        ),
        2154 => Some(format!(
            "+proj=lcc +lat_0=46.5 +lon_0=3 +lat_1=49 +lat_2=44 +x_0=700000 +y_0=6600000 {GRS80} +units=m +no_defs"
        )),
        2193 => Some(format!(
            "+proj=tmerc +lat_0=0 +lon_0=173 +k=0.9996 +x_0=1600000 +y_0=10000000 {GRS80} +units=m +no_defs"
        )),
        25828..=25838 => utm(code - 25800, GRS80),
        26901..=26923 => utm(code - 26900, "+datum=NAD83"),
        28348..=28358 => utm(code - 28300, &format!("+south {GRS80}")),
        32601..=32660 => utm(code - 32600, "+datum=WGS84"),
        32701..=32760 => utm(code - 32700, "+south +datum=WGS84"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(id: u16, data: Vec<u8>) -> Vlr {
        Vlr { user: PROJECTION.to_string(), id, data }
    }

    fn keys(entries: &[[u16; 4]]) -> Vec<u8> {
        let mut words = vec![1, 1, 0, entries.len() as u16];
        words.extend(entries.iter().flatten());
        words.iter().flat_map(|w| w.to_le_bytes()).collect()
    }

    fn found(records: &[Vlr]) -> Option<Crs> {
        find(records, &mut Vec::new())
    }

    #[test]
    fn wkt_without_its_zero_comes_before_keys() {
        let records = [
            record(34735, keys(&[[PROJECTED_CRS, 0, 1, 32633]])),
            record(2112, b"PROJCS[\"x\"]\0\0".to_vec()),
        ];
        assert_eq!(found(&records), Some(Crs { text: "PROJCS[\"x\"]".to_string(), source: CrsSource::Wkt }));
    }

    #[test]
    fn empty_wkt_gives_way_to_keys_and_empty_keys_to_wkt_or_nothing() {
        let mut notes = Vec::new();
        let records = [record(2112, vec![0; 4]), record(34735, keys(&[[PROJECTED_CRS, 0, 1, 32633]]))];
        let crs = find(&records, &mut notes).unwrap();
        assert_eq!(crs.text, "+proj=utm +zone=33 +datum=WGS84 +units=m +no_defs");
        assert_eq!(crs.source, CrsSource::GeoKeys);
        assert_eq!(notes.len(), 1);
        for empty in [keys(&[]), Vec::new(), vec![0; 8]] {
            let (wkt, mut notes) = (record(2112, b"PROJCS[\"x\"]".to_vec()), Vec::new());
            for records in [[record(34735, empty.clone()), wkt.clone()], [wkt, record(34735, empty)]] {
                let crs = find(&records, &mut notes);
                assert_eq!(
                    crs.map(|crs| (crs.text, crs.source)),
                    Some(("PROJCS[\"x\"]".into(), CrsSource::Wkt))
                );
            }
            assert_eq!(notes, [""; 0]);
        }
        assert_eq!(found(&[record(34735, keys(&[]))]), None);
        assert_eq!(found(&[record(34735, vec![1, 0, 1])]), None);
        assert_eq!(found(&[]), None);
    }

    #[test]
    fn codes_that_are_not_known_here_keep_their_number() {
        assert_eq!(found(&[record(34735, keys(&[[PROJECTED_CRS, 0, 1, 2994]]))]).unwrap().text, "EPSG:2994");
        assert_eq!(
            found(&[record(34735, keys(&[[GEODETIC_CRS, 0, 1, 4326]]))]).unwrap().text,
            "+proj=longlat +datum=WGS84 +no_defs"
        );
    }

    #[test]
    fn a_user_defined_projection_is_its_citation_never_its_datum() {
        let ascii = record(34737, b"Oregon North|NAD83|\0".to_vec());
        let directory = record(
            34735,
            keys(&[
                [GEODETIC_CRS, 0, 1, 4269],
                [PROJECTED_CRS, 0, 1, 32767],
                [PROJECTED_CITATION, ASCII_PARAMETERS, 13, 0],
            ]),
        );
        assert_eq!(found(&[directory, ascii]).unwrap().text, "Oregon North");
    }

    #[test]
    fn feet_are_not_metres() {
        let directory = record(34735, keys(&[[PROJECTED_CRS, 0, 1, 26910], [LINEAR_UNITS, 0, 1, 9003]]));
        assert_eq!(
            found(&[directory]).unwrap().text,
            "+proj=utm +zone=10 +datum=NAD83 +units=us-ft +no_defs"
        );
    }

    #[test]
    fn keys_that_point_outside_their_record_are_harmless() {
        let directory = record(
            34735,
            keys(&[[CITATION, ASCII_PARAMETERS, 60_000, 60_000], [PROJECTED_CITATION, 34736, 9, 9]]),
        );
        assert_eq!(found(&[directory]), None);
    }
}
