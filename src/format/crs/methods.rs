//! What the projection methods and parameters of WKT 1 (GDAL's and ESRI's names),
//! WKT 2 (EPSG's) and GeoTIFF are called in proj4.

/// A name's letters and digits, in lower case.
pub fn bare(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// A projection of proj4.
#[derive(Debug, Clone, Copy)]
pub struct ProjectionMethod {
    /// `+proj=` and what goes with it always.
    pub proj4: &'static str,
    /// What the parameter of the latitude of origin is in proj4: `lat_0`, or for
    /// some `lat_ts`.
    pub latitude: &'static str,
}

const fn method(proj4: &'static str) -> ProjectionMethod {
    ProjectionMethod { proj4, latitude: "lat_0" }
}

/// The method of this name.
pub fn method_of(name: &str) -> Option<ProjectionMethod> {
    Some(match bare(name).as_str() {
        "transversemercator" | "gausskruger" => method("+proj=tmerc"),
        "transversemercatorsouthorientated" | "transversemercatorsouthoriented" => {
            method("+proj=tmerc +axis=wsu")
        }
        "lambertconformalconic"
        | "lambertconformalconic1sp"
        | "lambertconformalconic2sp"
        | "lambertconicconformal1sp"
        | "lambertconicconformal2sp" => method("+proj=lcc"),
        "albers" | "albersequalarea" | "albersconicequalarea" => method("+proj=aea"),
        "mercator" | "mercator1sp" | "mercator2sp" | "mercatorvarianta" | "mercatorvariantb" => {
            ProjectionMethod { proj4: "+proj=merc", latitude: "" }
        }
        "popularvisualisationpseudomercator" | "mercatorauxiliarysphere" => method(WEB_MERCATOR),
        "polarstereographic" | "polarstereographicvarianta" | "polarstereographicvariantb" => {
            ProjectionMethod { proj4: "+proj=stere", latitude: "polar" }
        }
        "stereographic" => method("+proj=stere"),
        "obliquestereographic" | "doublestereographic" => method("+proj=sterea"),
        "cassini" | "cassinisoldner" => method("+proj=cass"),
        "lambertazimuthalequalarea" => method("+proj=laea"),
        "azimuthalequidistant" => method("+proj=aeqd"),
        "polyconic" | "americanpolyconic" => method("+proj=poly"),
        "newzealandmapgrid" => method("+proj=nzmg"),
        "sinusoidal" => method("+proj=sinu"),
        "millercylindrical" => method("+proj=mill"),
        "gnomonic" => method("+proj=gnom"),
        "equirectangular" | "equidistantcylindrical" | "platecarree" => method("+proj=eqc"),
        "hotineobliquemercator"
        | "hotineobliquemercatorvarianta"
        | "rectifiedskeworthomorphicnaturalorigin" => method("+proj=omerc +no_uoff"),
        "hotineobliquemercatorazimuthcenter"
        | "hotineobliquemercatorvariantb"
        | "obliquemercator"
        | "rectifiedskeworthomorphiccenter" => method("+proj=omerc"),
        "swissobliquecylindrical" | "swissobliquemercator" => method("+proj=somerc"),
        _ => return None,
    })
}

/// Web Mercator, which is a sphere with the coordinates of an ellipsoid.
pub const WEB_MERCATOR: &str = "+proj=merc +a=6378137 +b=6378137 +nadgrids=@null";

/// What a parameter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterKind {
    Angle,
    Length,
    Scale,
}

/// A parameter in proj4, without the plus.
pub fn parameter_of(name: &str) -> Option<(&'static str, ParameterKind)> {
    Some(match bare(name).as_str() {
        "latitudeoforigin"
        | "latitudeofnaturalorigin"
        | "latitudeoffalseorigin"
        | "latitudeofcenter"
        | "latitudeofcentre"
        | "latitudeofprojectioncentre" => ("lat_0", ParameterKind::Angle),
        "centralmeridian"
        | "longitudeoforigin"
        | "longitudeofnaturalorigin"
        | "longitudeoffalseorigin"
        | "longitudeofcenter"
        | "longitudeofcentre"
        | "straightverticallongitudefrompole"
        | "longitudeofprojectioncentre" => ("lon_0", ParameterKind::Angle),
        "standardparallel1" | "latitudeof1ststandardparallel" => ("lat_1", ParameterKind::Angle),
        "standardparallel2" | "latitudeof2ndstandardparallel" => ("lat_2", ParameterKind::Angle),
        "latitudeofstandardparallel" => ("lat_ts", ParameterKind::Angle),
        "azimuth" | "azimuthofinitialline" | "azimuthatprojectioncentre" => ("alpha", ParameterKind::Angle),
        "rectifiedgridangle" | "anglefromrectifiedtoskewgrid" => ("gamma", ParameterKind::Angle),
        "scalefactor"
        | "scalefactoratnaturalorigin"
        | "scalefactoroninitialline"
        | "scalefactoratprojectioncentre" => ("k", ParameterKind::Scale),
        "falseeasting" | "eastingatfalseorigin" | "eastingatprojectioncentre" => {
            ("x_0", ParameterKind::Length)
        }
        "falsenorthing" | "northingatfalseorigin" | "northingatprojectioncentre" => {
            ("y_0", ParameterKind::Length)
        }
        _ => return None,
    })
}

/// The method of GeoTIFF's ProjCoordTransGeoKey (OGC GeoTIFF 1.1, 7.5.4), by its
/// name in WKT 1.
pub fn geotiff_method(number: u16) -> Option<&'static str> {
    Some(match number {
        1 => "Transverse_Mercator",
        3 => "Hotine_Oblique_Mercator",
        7 => "Mercator_1SP",
        8 => "Lambert_Conformal_Conic_2SP",
        9 => "Lambert_Conformal_Conic_1SP",
        10 => "Lambert_Azimuthal_Equal_Area",
        11 => "Albers_Conic_Equal_Area",
        12 => "Azimuthal_Equidistant",
        14 => "Stereographic",
        15 => "Polar_Stereographic",
        16 => "Oblique_Stereographic",
        17 => "Equirectangular",
        18 => "Cassini_Soldner",
        19 => "Gnomonic",
        20 => "Miller_Cylindrical",
        22 => "Polyconic",
        24 => "Sinusoidal",
        26 => "New_Zealand_Map_Grid",
        27 => "Transverse_Mercator_South_Orientated",
        _ => return None,
    })
}
