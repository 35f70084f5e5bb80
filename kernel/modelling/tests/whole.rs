//! From cloud to model, on furniture that training never saw, and on what is no furniture.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sagci_furniture::{Category, Labelled, Look, Noise, Object, Random, STILL, families, look};
use sagci_modelling::{ModellingError, Perceived, Weights, analyse, perceive};

fn weights() -> Weights {
    Weights::shipped().unwrap()
}

fn seen(category: Category, seed: u64) -> (Object, Labelled) {
    seen_with(category, seed, None)
}

fn seen_with(category: Category, seed: u64, noise: Option<Noise>) -> (Object, Labelled) {
    let mut random = Random::new(seed, "tests of modelling");
    let of = families(category, true);
    let object = of[seed as usize % of.len()].draw(&mut random);
    let noise = noise.unwrap_or_else(|| Noise::draw(&mut random));
    let how = Look { views: 2, width: 280, points: 15_000, near: 1.0, around: false, surroundings: false, noise };
    let cloud = look(&object, &how, &mut random);
    (object, cloud)
}

fn model(cloud: &[Point3<f64>]) -> Perceived {
    perceive(cloud, "thing", &weights()).unwrap()
}

/// Of each part of a cloud's model its link's name and the share of its points within 5 mm of its mesh; every mesh has to be closed.
fn held(category: Category, noise: Option<Noise>) -> Vec<(String, usize, f64)> {
    let (_, cloud) = seen_with(category, 1, noise);
    let found = model(&cloud.points);
    let folder = tempfile::tempdir().unwrap();
    found.write(folder.path(), &cloud.points, "{}").unwrap();
    let read = sagci_model::ObjectModel::read(folder.path()).unwrap();
    assert_eq!(read.links.len(), found.report.parts.len());
    let state: Vec<f64> = found.report.joints.iter().map(|j| j.state).collect();
    let poses = read.X_OL(&state);
    let mut shares = Vec::new();
    for (id, link) in read.links.iter().enumerate() {
        let sagci_model::Geometry::Mesh { mesh, .. } = &link.visuals[0].geometry else { panic!("no mesh") };
        assert!(mesh.is_closed() && mesh.volume() > 0.0, "{category:?} {}", link.name);
        let mut edges = std::collections::HashMap::new();
        for t in &mesh.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
            }
        }
        assert!(edges.values().all(|n| *n == 2), "{category:?} {}: an edge has not two faces", link.name);
        let own: Vec<Point3<f64>> =
            cloud.points.iter().zip(&found.part).filter(|(_, p)| **p == id as i32).map(|(p, _)| poses[id].inverse() * p).collect();
        let near = own.iter().step_by(7).filter(|p| distance(p, mesh) < 0.005).count();
        shares.push((format!("{category:?} {}", link.name), own.len(), near as f64 / own.iter().step_by(7).count() as f64));
    }
    shares
}

#[test]
fn meshes_are_closed_and_hold_their_points_and_the_model_loads() {
    for category in Category::ALL {
        // A surface is no better than its points: how far those lie from it is asked of a camera that measures to a millimetre.
        for (part, _, share) in held(category, Some(Noise { axial: 0.001, grazing: 0.1, ..Noise::NONE })) {
            assert!(share > 0.95, "{part}: {share} of its points lie within 5 mm");
        }
    }
}

#[test]
fn meshes_hold_the_points_of_a_usual_camera_as_well() {
    // Noise of many millimetres at two metres, flying pixels, errors of pose.
    let all: Vec<(String, usize, f64)> = Category::ALL.into_iter().flat_map(|c| held(c, None)).collect();
    let total: usize = all.iter().map(|p| p.1).sum();
    let share = all.iter().map(|p| p.1 as f64 * p.2).sum::<f64>() / total as f64;
    assert!(share > 0.95, "{share} of all points lie within 5 mm: {all:#?}");
}

/// Distance to a mesh's surface.
fn distance(p: &Point3<f64>, mesh: &sagci_model::TriangleMesh) -> f64 {
    let at = |i: u32| mesh.vertices[i as usize];
    mesh.triangles.iter().map(|t| to_triangle(p, at(t[0]), at(t[1]), at(t[2]))).fold(f64::INFINITY, f64::min)
}

/// Ericson 2005, 5.1.5.
fn to_triangle(p: &Point3<f64>, a: Point3<f64>, b: Point3<f64>, c: Point3<f64>) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.norm();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.norm();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (p - (a + ab * (d1 / (d1 - d3)))).norm();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.norm();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (p - (a + ac * (d2 / (d2 - d6)))).norm();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (p - (b + (c - b) * w)).norm();
    }
    let k = 1.0 / (va + vb + vc);
    (p - (a + ab * (vb * k) + ac * (vc * k))).norm()
}

#[test]
fn every_input_point_keeps_its_place_and_has_a_part_or_none() {
    let (_, cloud) = seen(Category::Microwave, 2);
    let mut points = cloud.points.clone();
    points[3].x = f64::NAN;
    points[4] = Point3::new(f64::INFINITY, 0.0, 0.0);
    let found = model(&points);
    assert_eq!(found.part.len(), points.len());
    assert_eq!((found.part[3], found.part[4]), (-1, -1));
    for part in &found.report.parts {
        assert_eq!(part.points, found.part.iter().filter(|p| **p == part.id as i32).count());
        assert!(found.model.link(&part.link).is_some());
    }
    for joint in &found.report.joints {
        let axis = Vector3::from(joint.axis);
        assert!((axis.norm() - 1.0).abs() < 1e-9 && joint.lower <= joint.state && joint.state <= joint.upper);
        assert!(found.model.joint(&joint.name).is_some());
        let p = joint.probabilities;
        assert!((p.fixed + p.revolute + p.prismatic - 1.0).abs() < 1e-3);
    }
}

#[test]
fn turning_the_world_turns_the_answer() {
    // Points fall into other cells, so what hangs on a thread may fall the other way; most may not.
    let (mut same, mut all) = (0, 0);
    for (seed, category) in (0..12).map(|k| (k, Category::ALL[k as usize % 6])) {
        let (_, cloud) = seen(category, seed);
        let first = model(&cloud.points);
        let yaw = 0.4 + 1.3 * seed as f64;
        let X = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.5), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw));
        let turned: Vec<Point3<f64>> = cloud.points.iter().map(|p| X * p).collect();
        let second = model(&turned);
        all += first.report.joints.len().max(second.report.joints.len());
        for a in &first.report.joints {
            let alike = |b: &&sagci_modelling::JointReport| {
                let along = (X.rotation * Vector3::from(a.axis)).dot(&Vector3::from(b.axis));
                let d = X * Point3::from(a.origin) - Point3::from(b.origin);
                let axis = Vector3::from(b.axis);
                a.kind == b.kind && along > 0.995 && (a.kind == "prismatic" || (d - axis * d.dot(&axis)).norm() < 0.03)
            };
            same += usize::from(second.report.joints.iter().any(|b| alike(&b)));
        }
    }
    assert!(same * 2 >= all, "{same} of {all} joints are the same after a turn");
}

#[test]
fn millimetres_are_noticed_and_told() {
    let (_, cloud) = seen(Category::Oven, 1);
    let first = model(&cloud.points);
    let large: Vec<Point3<f64>> = cloud.points.iter().map(|p| p * 1000.0).collect();
    let second = model(&large);
    assert!(second.report.notes.iter().any(|n| n.contains("millimetres") && n.contains("0.001")), "{:?}", second.report.notes);
    assert_eq!(first.report.joints.len(), second.report.joints.len());
    for (a, b) in first.report.joints.iter().zip(&second.report.joints) {
        // In the input's unit.
        let off = (Point3::from(a.origin) - Point3::from(b.origin) / 1000.0).norm();
        assert!(off < 0.02, "{off}");
    }
}

#[test]
fn what_cannot_be_modelled_is_refused_with_a_reason() {
    let w = weights();
    let error = |points: &[Point3<f64>]| perceive(points, "x", &w).unwrap_err();
    assert!(matches!(error(&[]), ModellingError::TooFew { finite: 0, .. }));
    assert!(matches!(error(&vec![Point3::new(f64::NAN, 0.0, 0.0); 5000]), ModellingError::TooFew { finite: 0, total: 5000, .. }));
    let plane: Vec<Point3<f64>> = (0..4000).map(|i| Point3::new(f64::from(i % 63) * 0.01, f64::from(i / 63) * 0.01, 0.3)).collect();
    assert!(matches!(error(&plane), ModellingError::Flat { .. }));
    assert!(matches!(error(&vec![Point3::new(1.0, 2.0, 3.0); 4000]), ModellingError::Flat { .. }));
    let line: Vec<Point3<f64>> = (0..4000).map(|i| Point3::new(f64::from(i) * 1e-3, f64::from(i) * 2e-3, 0.0)).collect();
    assert!(matches!(error(&line), ModellingError::Flat { .. }));
    let two: Vec<Point3<f64>> = seen(Category::Microwave, 2).1.points.iter().flat_map(|p| [*p, p + Vector3::new(3.0, 0.0, 0.0)]).collect();
    assert!(matches!(error(&two), ModellingError::Several { count: 2, .. }));
}

/// A door that stands open may be seen with nothing of what joins it to its case: that is no second object. A second case is one.
#[test]
fn a_leaf_apart_from_its_case_is_not_refused() {
    let mut random = Random::new(1, "apart");
    let [w, d, h] = [0.5, 0.4, 0.3];
    let mut case: Vec<Point3<f64>> = Vec::new();
    for _ in 0..4000 {
        let [a, b] = [random.unit(), random.unit()];
        case.push(Point3::new(0.0, a * w, b * h));
        case.push(Point3::new(-a * d, 0.0, b * h));
        case.push(Point3::new(-a * d, b * w, h));
    }
    // The outer part of a leaf that is open by a right angle.
    let leaf: Vec<Point3<f64>> = (0..2500).map(|_| Point3::new(random.between(0.42, 0.7), w, random.unit() * h)).collect();
    let all: Vec<Point3<f64>> = case.iter().chain(&leaf).copied().collect();
    let notes = analyse(&all).unwrap()[0].notes().join("; ");
    assert!(notes.contains("there may be 2 objects"), "{notes}");
    let second = case.iter().step_by(4).map(|p| p + Vector3::new(1.2, 0.0, 0.0));
    let two: Vec<Point3<f64>> = case.iter().copied().chain(second).collect();
    assert!(matches!(analyse(&two).err(), Some(ModellingError::Several { count: 2, .. })));
}

#[test]
fn a_ball_is_rigid() {
    let mut random = Random::new(1, "ball");
    let points: Vec<Point3<f64>> =
        (0..6000).map(|_| Point3::from(Vector3::new(random.normal(), random.normal(), random.normal()).normalize() * 0.15)).collect();
    let found = model(&points);
    assert!(found.report.rigid && found.report.joints.is_empty() && found.report.reason.is_some());
    assert_eq!(found.report.parts.len(), 1);
}

#[test]
fn a_chair_is_rigid_more_often_than_not_and_says_why() {
    // Chairs were never trained on. Pots and mugs are taken for furniture too often to be asked for here.
    let chair = STILL.iter().find(|f| f.name == "chair").unwrap();
    let mut rigid = 0;
    let seeds = 0..12;
    for seed in seeds.clone() {
        let mut random = Random::new(seed, "still");
        let object = chair.draw(&mut random);
        let how =
            Look { views: 2, width: 280, points: 12_000, near: 1.0, around: false, surroundings: false, noise: Noise::draw(&mut random) };
        let found = model(&look(&object, &how, &mut random).points);
        if found.report.rigid {
            rigid += 1;
            assert!(found.report.joints.is_empty() && found.report.parts.len() == 1 && found.report.reason.is_some());
        }
    }
    assert!(rigid * 2 > seeds.count(), "{rigid} chairs are rigid");
}

#[test]
fn five_million_points_are_thinned_and_told() {
    let (_, cloud) = seen(Category::Box, 4);
    let mut random = Random::new(4, "many");
    let mut near = |p: &Point3<f64>| p + Vector3::new(random.normal(), random.normal(), random.normal()) * 5e-4;
    let many: Vec<Point3<f64>> = cloud.points.iter().cycle().take(5_000_000).map(&mut near).collect();
    let found = model(&many);
    assert_eq!(found.part.len(), many.len());
    assert!(found.report.notes.iter().any(|n| n.contains("5000000 points were thinned")), "{:?}", found.report.notes);
}

#[test]
fn a_stored_model_stands_on_the_ground_with_its_front_along_minus_y() {
    let (object, cloud) = seen(Category::Microwave, 2);
    let found = model(&cloud.points);
    // The front is x of the object's own frame.
    let front = found.X_WO.inverse().rotation * (cloud.X_WF.rotation * Vector3::x());
    assert!(front.dot(&-Vector3::y()) > 0.99, "{front}");
    let (low, _) = object.bounds();
    assert!((found.X_WO.translation.z - (cloud.X_WF.translation.z + low.z)).abs() < 0.05);
    let (seen, stored) = (&found.model, found.standing());
    let q: Vec<f64> = found.report.joints.iter().map(|j| j.state).collect();
    for (a, b) in seen.X_OL(&q).iter().zip(stored.X_OL(&q)).skip(1) {
        let off = found.X_WO * b * a.inverse();
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9, "{off}");
    }
}

#[test]
fn a_cloud_far_from_its_origin_is_modelled_as_it_is_nearby() {
    let (_, cloud) = seen(Category::Microwave, 1);
    let near = model(&cloud.points);
    let by = Vector3::new(412_345.0, 5_812_777.0, 0.0);
    let far = model(&cloud.points.iter().map(|p| p + by).collect::<Vec<_>>());
    assert_eq!(near.report.joints.len(), far.report.joints.len());
    for (a, b) in near.report.joints.iter().zip(&far.report.joints) {
        let off = Point3::from(b.origin) - by - Point3::from(a.origin);
        assert!(off.norm() < 0.01 && a.kind == b.kind, "{} is off by {}", a.name, off.norm());
    }
    let links = |p: &Perceived| p.model.links.iter().map(|l| l.inertial.mass).sum::<f64>();
    // Cells begin elsewhere, and pieces with them.
    assert!((links(&near) - links(&far)).abs() < 0.2 * links(&near));
}

#[test]
fn how_far_a_joint_goes_is_in_metres_whatever_the_cloud_is_in() {
    let (_, cloud) = (0..20)
        .map(|seed| seen(Category::Storage, seed))
        .find(|(_, c)| model(&c.points).report.joints.iter().any(|j| j.kind == "prismatic"))
        .unwrap();
    let reaches = |scale: f64| -> Vec<f64> {
        let found = model(&cloud.points.iter().map(|p| p * scale).collect::<Vec<_>>());
        assert_eq!(found.report.notes.iter().any(|n| n.contains("seems to be in")), scale > 1.0, "{:?}", found.report.notes);
        found.report.joints.iter().filter(|j| j.kind == "prismatic").map(|j| j.upper).collect()
    };
    for scale in [1.0, 100.0, 1000.0] {
        let all = reaches(scale);
        // No drawer of the house is longer than its depth.
        assert!(all.iter().all(|m| (0.05..1.5).contains(m)), "at {scale} times: {all:?} m");
    }
}

#[test]
fn a_sheet_with_a_cameras_noise_is_no_door() {
    let mut random = Random::new(3, "sheet");
    for noise in [0.0005, 0.001, 0.003] {
        let sheet: Vec<Point3<f64>> =
            (0..15_000).map(|_| Point3::new(random.between(0.0, 1.0), noise * random.normal(), random.between(0.0, 0.8))).collect();
        assert!(matches!(perceive(&sheet, "x", &weights()), Err(ModellingError::Flat { .. })), "noise of {noise} m");
    }
}

#[test]
fn an_open_drawer_is_measured_from_where_it_shuts() {
    let (mut off, mut open) = (Vec::new(), 0);
    for seed in 0..16 {
        let mut random = Random::new(seed, "open drawers");
        let family = sagci_furniture::FAMILIES.iter().find(|f| f.name == ["chest_of_drawers", "nightstand"][seed as usize % 2]).unwrap();
        let mut object = family.draw(&mut random);
        object.joints.iter_mut().for_each(|j| j.state = j.upper * random.pick([0.0, 0.4, 0.8]));
        let noise = Noise { axial: 0.001, grazing: 0.1, ..Noise::NONE };
        let how = Look { views: 2, width: 320, points: 20_000, near: 1.0, around: false, surroundings: false, noise };
        let cloud = look(&object, &how, &mut random);
        let found = model(&cloud.points);
        for joint in object.joints.iter().filter(|j| j.kind == sagci_furniture::Kind::Prismatic) {
            let own =
                |part: usize| cloud.part.iter().zip(&found.part).filter(|(t, f)| **t == joint.part as i32 && **f == part as i32).count();
            let seen = cloud.part.iter().filter(|t| **t == joint.part as i32).count();
            let Some(part) = found.report.parts.iter().skip(1).find(|p| 2 * own(p.id) > seen.max(p.points)) else { continue };
            let Some(answer) = found.report.joints.iter().find(|j| j.child == part.link && j.kind == "prismatic") else { continue };
            off.push((answer.state - joint.state).abs());
            open += usize::from(joint.state > 0.0);
            assert!(answer.lower <= answer.state && answer.state <= answer.upper);
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(open >= 8, "only {open} open drawers were found");
    assert!(off[off.len() / 2] < 0.02 && off[off.len() * 8 / 10] < 0.05, "{off:.3?}");
}
