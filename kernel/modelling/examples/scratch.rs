#![allow(missing_docs, clippy::unwrap_used)]
use sagci_furniture as f;
use std::io::Write;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let seed: u64 = args[1].parse().unwrap();
    let dir = &args[2];
    let n: usize = args.get(3).and_then(|s| s.parse().ok()).unwrap_or(12);
    let mut total = (0.0, 0.0, 0usize);
    for k in 0..n {
        let fam = &f::FAMILIES[(k * 5 + seed as usize) % f::FAMILIES.len()];
        let mut r = f::Random::new(seed * 1000 + k as u64, "scratch");
        let o = fam.draw(&mut r);
        let t = std::time::Instant::now();
        let l = f::look(&o, &f::Look::draw(&mut r), &mut r);
        total.0 += t.elapsed().as_secs_f64();
        total.2 += 1;
        let t = std::time::Instant::now();
        let a = sagci_modelling::analyse(&l.points).unwrap();
        let dt = t.elapsed().as_secs_f64();
        total.1 += dt;
        let piece = a.piece_of_input();
        // purity: best achievable label by majority per piece
        let np = a.pieces();
        let mut count = vec![std::collections::HashMap::<i32, usize>::new(); np];
        for (p, q) in l.part.iter().zip(&piece) { if let Some(q) = q { *count[*q as usize].entry(*p).or_default() += 1; } }
        let best: Vec<i32> = count.iter().map(|c| c.iter().max_by_key(|x| *x.1).map_or(-1, |x| *x.0)).collect();
        let mut line = String::new();
        for part in 0..o.parts.len() as i32 {
            let (mut i, mut u) = (0, 0);
            for (p, q) in l.part.iter().zip(&piece) {
                let b = q.map_or(-1, |q| best[q as usize]);
                if *p == part && b == part { i += 1; }
                if *p == part || b == part { u += 1; }
            }
            line += &format!(" {:.2}({}{})", i as f64 / (u as f64).max(1.0), u, if part > 0 { format!(",{:.2}", o.joints[part as usize - 1].state / o.joints[part as usize - 1].upper) } else { String::new() });
        }
        println!("{k} {} {} pts {} pieces {} yaw ms {:.0}: oracle IoU{}", fam.category.name(), fam.name, l.points.len(), np, 1e3 * dt, line);
        let mut file = std::fs::File::create(format!("{dir}/{k}.txt")).unwrap();
        for i in 0..l.points.len() {
            let q = l.X_WF.inverse() * l.points[i];
            writeln!(file, "{} {} {} {} {}", q.x, q.y, q.z, l.part[i], piece[i].map_or(-1, |x| x as i32)).unwrap();
        }
    }
    println!("camera {:.3} s, analyse {:.3} s a cloud", total.0 / total.2 as f64, total.1 / total.2 as f64);
}
