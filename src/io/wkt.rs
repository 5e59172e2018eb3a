//! Well-known text of coordinate reference systems, WKT1 and WKT2: the horizontal CRS and the vertical unit.
//!
//! # Reference
//! OGC 01-009 (WKT1) and OGC 18-010r7 (WKT2:2019).

use crate::raster::{Crs, LengthUnit};

/// Deepest nesting read. chosen: real texts nest 8 deep; the limit keeps the stack small.
const MAX_DEPTH: usize = 32;

/// The horizontal CRS and the vertical unit a text names; `None` for what it does not, or does not legibly.
///
/// The CRS is its EPSG code where the text gives one, a PROJ string otherwise.
pub fn parse(text: &str) -> (Option<Crs>, Option<LengthUnit>) {
    let mut rest = text.trim_end_matches('\0').trim();
    let (mut found_crs, mut found_unit) = (None, None);
    // ESRI writes the vertical CRS as a second root behind the first
    for _ in 0..2 {
        let Some(root) = read_node(rest) else { break };
        rest = rest[root.text.len()..].trim_start_matches([',', ' ', '\t', '\r', '\n']);
        let (horizontal, vertical) = split(&root);
        found_crs = found_crs.or_else(|| horizontal.and_then(crs));
        found_unit = found_unit.or_else(|| vertical.and_then(unit));
    }
    (found_crs, found_unit)
}

/// The text, WKT1, of a system of the registry; `None` for others, and for the few whose definitions lack it.
pub fn of(crs: &Crs) -> Option<&'static str> {
    let &Crs::Epsg(code) = crs else { return None };
    let known = crs_definitions::from_code(u16::try_from(code).ok()?)?;
    Some(known.wkt).filter(|text| !text.is_empty())
}

/// One `KEYWORD[…]` of a text.
#[derive(Debug)]
pub(super) struct Node<'a> {
    keyword: String,
    /// Quoted strings without their quotes, numbers and bare words, in order.
    pub(super) values: Vec<&'a str>,
    pub(super) children: Vec<Node<'a>>,
    /// The node as it stands in the text.
    text: &'a str,
}

impl Node<'_> {
    pub(super) fn is(&self, keywords: &[&str]) -> bool {
        keywords.contains(&self.keyword.as_str())
    }

    /// The first child with one of these keywords.
    pub(super) fn child(&self, keywords: &[&str]) -> Option<&Self> {
        self.children.iter().find(|child| child.is(keywords))
    }

    /// The code that the EPSG registry has for the node.
    pub(super) fn epsg(&self) -> Option<u32> {
        self.children.iter().filter(|c| c.is(&["AUTHORITY", "ID"])).find_map(|id| {
            let registry = id.values.first()?;
            registry.eq_ignore_ascii_case("EPSG").then(|| id.values.get(1)?.parse().ok()).flatten()
        })
    }
}

/// The node of the horizontal CRS in a text.
pub(super) fn horizontal(text: &str) -> Option<Node<'_>> {
    let mut node = read_node(text)?;
    while !is_horizontal(&node) {
        let next = node.children.into_iter().find(|child| split(child).0.is_some())?;
        node = next;
    }
    Some(node)
}

/// The horizontal and the vertical part of a CRS, where it has them.
fn split<'n, 'a>(node: &'n Node<'a>) -> (Option<&'n Node<'a>>, Option<&'n Node<'a>>) {
    if node.is(&["COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS"]) {
        // a bound CRS holds its target as well: the source comes first
        let parts = node.children.iter().map(split);
        return parts.fold((None, None), |(h, v), part| (h.or(part.0), v.or(part.1)));
    }
    if node.is(&["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"]) {
        return (None, Some(node));
    }
    (is_horizontal(node).then_some(node), None)
}

fn is_horizontal(node: &Node<'_>) -> bool {
    node.is(&[
        "PROJCS",
        "PROJCRS",
        "PROJECTEDCRS",
        "GEOGCS",
        "GEOGCRS",
        "GEOGRAPHICCRS",
        "GEODCRS",
        "GEODETICCRS",
    ])
}

fn crs(node: &Node<'_>) -> Option<Crs> {
    if let Some(code) = node.epsg() {
        return Some(Crs::Epsg(code));
    }
    proj4wkt::wkt_to_projstring(node.text).ok().map(|p| Crs::of_proj(p.trim().to_owned()))
}

/// The first unit within a vertical CRS: its own, or its axis's.
fn unit(node: &Node<'_>) -> Option<LengthUnit> {
    if node.is(&["UNIT", "LENGTHUNIT"]) {
        let metres: f64 = node.values.get(1)?.parse().ok()?;
        // the two feet differ by 2e-6 of themselves
        return [LengthUnit::Metre, LengthUnit::Foot, LengthUnit::UsSurveyFoot]
            .into_iter()
            .find(|unit| (unit.metres() - metres).abs() < 1e-7 * unit.metres());
    }
    node.children.iter().find_map(unit)
}

/// The text's one node; `None` if it is malformed or nested too deep.
fn read_node(text: &str) -> Option<Node<'_>> {
    let mut open: Vec<(Node<'_>, usize)> = Vec::new();
    let mut rest = 0;
    loop {
        rest += text[rest..].len()
            - text[rest..].trim_start_matches([' ', '\t', '\r', '\n', ',']).len();
        let tail = &text[rest..];
        let first = tail.chars().next()?;
        if first == ']' || first == ')' {
            rest += 1;
            let (mut node, start) = open.pop()?;
            node.text = &text[start..rest];
            match open.last_mut() {
                Some((parent, _)) => parent.children.push(node),
                None => return Some(node),
            }
        } else if first == '"' {
            let (value, after) = quoted(tail)?;
            open.last_mut()?.0.values.push(value);
            rest += after;
        } else {
            let end = tail.find(['[', '(', ']', ')', ',', '"'])?;
            let word = tail[..end].trim();
            if word.is_empty() {
                return None;
            }
            if tail[end..].starts_with(['[', '(']) {
                if open.len() == MAX_DEPTH {
                    return None;
                }
                let keyword = word.to_ascii_uppercase();
                let node = Node { keyword, values: Vec::new(), children: Vec::new(), text: "" };
                open.push((node, rest));
                rest += end + 1;
            } else {
                open.last_mut()?.0.values.push(word);
                rest += end;
            }
        }
    }
}

/// The string in quotes at the start of `text`, and where it ends. `""` within stands for one quote.
fn quoted(text: &str) -> Option<(&str, usize)> {
    let mut end = 1;
    loop {
        end += text[end..].find('"')?;
        if !text[end + 1..].starts_with('"') {
            return Some((&text[1..end], end + 1));
        }
        end += 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const UTM_17N: &str = r#"PROJCS["NAD83 / UTM zone 17N",GEOGCS["NAD83",DATUM["North_American_Datum_1983",
        SPHEROID["GRS 1980",6378137,298.257222101,AUTHORITY["EPSG","7019"]],AUTHORITY["EPSG","6269"]],
        PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4269"]],
        PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",-81],
        PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],
        UNIT["metre",1]AUTHORITY]"#;

    fn utm(authority: &str) -> String {
        UTM_17N.replace("AUTHORITY]", &format!("{authority}]"))
    }

    fn compound(vertical: &str) -> String {
        format!(r#"COMPD_CS["both",{},{vertical}]"#, utm(r#",AUTHORITY["EPSG","26917"]"#))
    }

    #[test]
    fn the_code_is_the_crs_own_and_not_its_datums() {
        assert_eq!(parse(&utm(r#",AUTHORITY["EPSG","26917"]"#)), (Some(Crs::Epsg(26917)), None));
        let without = parse(&utm("")).0;
        assert_eq!(without, Some(Crs::Epsg(26917)));
        let own = utm("").replace("\"central_meridian\",-81", "\"central_meridian\",-80");
        let Some(Crs::Proj(proj)) = parse(&own).0 else { panic!("{own:?}") };
        assert!(proj.starts_with("+proj=tmerc") && proj.contains("+lon_0=-80"), "{proj}");
    }

    #[test]
    fn the_vertical_unit_is_the_vertical_crs_s() {
        let vertical = |unit: &str| {
            parse(&compound(&format!(
                r#"VERT_CS["NAVD88 height",VERT_DATUM["North American Vertical Datum 1988",2005],{unit},AXIS["Up",UP]]"#
            )))
        };
        let crs = Some(Crs::Epsg(26917));
        assert_eq!(vertical(r#"UNIT["metre",1]"#), (crs.clone(), Some(LengthUnit::Metre)));
        let survey_foot = vertical(r#"UNIT["US survey foot",0.3048006096012192]"#);
        assert_eq!(survey_foot, (crs.clone(), Some(LengthUnit::UsSurveyFoot)));
        assert_eq!(vertical(r#"UNIT["foot",0.3048]"#), (crs.clone(), Some(LengthUnit::Foot)));
        assert_eq!(vertical(r#"UNIT["fathom",1.8288]"#), (crs, None));
    }

    #[test]
    fn issue_2_esri_vertical_cs() {
        let vertical = r#"VERTCS["NAVD_1988_Foot_US",VDATUM["North_American_Vertical_Datum_1988"],PARAMETER["Vertical_Shift",0.0],PARAMETER["Direction",1.0],UNIT["Foot_US",0.3048006096012192]]"#;
        for joint in [",", "", "\n"] {
            let text = format!("{}{joint}{vertical}\n", utm(""));
            let expected = (Some(Crs::Epsg(26917)), Some(LengthUnit::UsSurveyFoot));
            assert_eq!(parse(&text), expected, "{joint:?}");
        }
    }

    #[test]
    fn wkt2_is_read() {
        let text = r#"COMPOUNDCRS["ETRS89 / UTM 32N + DHHN2016 height",
            PROJCRS["ETRS89 / UTM zone 32N",BASEGEOGCRS["ETRS89",DATUM["European Terrestrial Reference System 1989",
            ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1]]],ID["EPSG",4258]],
            CONVERSION["UTM zone 32N",METHOD["Transverse Mercator",ID["EPSG",9807]]],
            CS[Cartesian,2],AXIS["(E)",east],AXIS["(N)",north],LENGTHUNIT["metre",1],ID["EPSG",25832]],
            VERTCRS["DHHN2016 height",VDATUM["Deutsches ""Haupthöhennetz"" 2016"],CS[vertical,1],
            AXIS["gravity-related height (H)",up,LENGTHUNIT["metre",1]],ID["EPSG",7837]]]"#;
        assert_eq!(parse(text), (Some(Crs::Epsg(25832)), Some(LengthUnit::Metre)));
        let bound = format!("BOUNDCRS[SOURCECRS[{}],TARGETCRS[GEOGCRS[\"WGS 84\"]]]", {
            r#"PROJCRS["x",ID["EPSG",3794]]"#
        });
        assert_eq!(parse(&bound).0, Some(Crs::Epsg(3794)));
    }

    #[test]
    fn what_is_no_crs_gives_nothing() {
        let deep = "A[".repeat(100_000);
        for text in ["", "]", "nonsense", "PROJCS[", "PROJCS[\"a", r#"LOCAL_CS["plan"]"#, &deep] {
            assert_eq!(parse(text), (None, None), "{text:.40}");
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(cut in 0..1200_usize, garbage in ".{0,12}") {
            let whole = compound(r#"VERT_CS["h",UNIT["metre",1]]"#);
            let at = (0..=cut.min(whole.len())).rev().find(|i| whole.is_char_boundary(*i)).unwrap();
            parse(&format!("{}{garbage}{}", &whole[..at], &whole[at..]));
            parse(&whole[..at]);
            parse(&garbage);
        }
    }
}
