use std::time::Instant;
use wildwood::{io::{Limits, las}, progress::Reporter, raster::Crs, terrain::point_cloud::{self, synthetic}};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let path = std::path::Path::new(&args[1]);
    if args.len() > 2 && args[2] == "make" {
        let t = Instant::now();
        let c = synthetic::forest(1, 1000.0, 4.0);
        println!("make {:?}", t.elapsed());
        las::write_laz(&c, path).unwrap();
        println!("write {:?}", t.elapsed());
        return;
    }
    let t = Instant::now();
    let mut c = las::read(path, None, &Limits::default()).unwrap();
    println!("read {:?} {} points {:?} {:?}", t.elapsed(), c.len(), c.crs, c.vertical_unit);
    for p in &args[4..] { c.append(las::read(std::path::Path::new(p), None, &Limits::default()).unwrap()); }
    let r = Reporter::silent();
    let params = point_cloud::Params { cell_m: args.get(3).and_then(|c| c.parse().ok()), ..Default::default() };
    let t2 = Instant::now();
    let s = point_cloud::surfaces(&c, Crs::Local, &params, &r).unwrap();
    println!("surfaces {:?} total {:?}", t2.elapsed(), t.elapsed());
    println!("{:?} {} {} {}", s.dem.frame(), s.dem.mask().valid_count(), s.dsm.mask().valid_count(), s.chm.mask().valid_count());
    for rec in r.records() { println!("{} {:.3} s {:?}", rec.stage, rec.seconds, rec.peak_memory_mib); }
    for w in r.warnings() { println!("{w}"); }
    if let Some(out) = args.get(2).filter(|o| *o != "-") {
        let f = s.dem.frame();
        let mut b = Vec::new();
        for v in [f.rows as f64, f.cols as f64, f.transform.west_m, f.transform.north_m, f.transform.cell_m] { b.extend(v.to_le_bytes()); }
        for g in [&s.dem, &s.dsm, &s.chm] {
            for (v, ok) in g.values().iter().zip(g.mask().as_slice()) { b.extend((if *ok { *v } else { f32::NAN }).to_le_bytes()); }
        }
        std::fs::write(out, b).unwrap();
    }
}
