//! What is true of drawn furniture, and of what the camera sees of it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use nalgebra::{Isometry3, Point3, Vector3};
use sagci_furniture::{
    Camera, Category, Class, Even, FAMILIES, Form, Kind, Labelled, Look, Noise, Object, Random, Solid, cast, evenly, families, look,
};

fn exact(views: usize) -> Look {
    Look { views, width: 120, points: usize::MAX, near: 1.0, around: false, surroundings: false, noise: Noise::NONE }
}

#[test]
fn every_category_has_families_on_both_sides() {
    for category in Category::ALL {
        assert!(families(category, false).len() >= 2 && families(category, true).len() >= 2, "{category:?}");
    }
}

#[test]
fn every_joint_opens_away_from_the_body() {
    for family in FAMILIES {
        for seed in 0..6 {
            let object = family.draw(&mut Random::new(seed, family.name));
            assert_eq!(object.joints.len() + 1, object.parts.len(), "{}", family.name);
            for joint in &object.joints {
                let part = &object.parts[joint.part];
                assert!(joint.upper > 0.0 && (0.0..=joint.upper).contains(&joint.state), "{}", family.name);
                assert_ne!(part.class, Class::Body);
                let at = part.solids[0].center;
                let moved = joint.X_FP(1e-3) * at - at;
                let sideways = joint.kind == Kind::Prismatic && part.class == Class::Door;
                assert!(sideways || moved.x + moved.z > 0.0, "{} goes {moved:?} when it opens", family.name);
            }
        }
    }
}

/// Is each point on a solid of its part?
fn on_their_parts(object: &Object, cloud: &Labelled) -> bool {
    let poses = object.X_FP();
    cloud.points.iter().zip(&cloud.part).all(|(p, part)| {
        let p_P = poses[*part as usize].inverse() * (cloud.X_WF.inverse() * p);
        object.parts[*part as usize].solids.iter().any(|s| {
            let d = (p_P - s.center).abs();
            let inside = (0..3).all(|k| d[k] < s.half[k] + 1e-6);
            let border = match s.form {
                Form::Box => (0..3).any(|k| d[k] > s.half[k] - 1e-6),
                Form::Cylinder(a) => {
                    let r = d[(a + 1) % 3].hypot(d[(a + 2) % 3]);
                    r < s.half[(a + 1) % 3] + 1e-6 && (r > s.half[(a + 1) % 3] - 1e-6 || d[a] > s.half[a] - 1e-6)
                }
            };
            inside && border
        })
    })
}

#[test]
fn without_noise_every_point_lies_on_the_part_it_is_told_to() {
    for family in FAMILIES {
        let mut random = Random::new(7, family.name);
        let object = family.draw(&mut random);
        let cloud = look(&object, &exact(1), &mut random);
        assert!(cloud.points.len() > 500, "{} is hardly seen", family.name);
        assert!(on_their_parts(&object, &cloud), "{}: a point is off its part's surface", family.name);
        let even = evenly(&object, &Even { views: 2, points: 4000, noise: 0.0 }, &mut random);
        assert!(even.points.len() > 500 && on_their_parts(&object, &even), "{}: a point is off its part's surface", family.name);
    }
}

#[test]
fn what_is_sampled_evenly_is_as_dense_on_faces_that_are_seen_askew() {
    let mut object = FAMILIES[0].draw(&mut Random::new(1, "block"));
    object.joints.clear();
    object.parts.truncate(1);
    // A small block within does not show.
    let within = Solid::between([-0.1, -0.1, 0.1], [0.1, 0.1, 0.2]);
    object.parts[0].solids = vec![Solid::between([-0.3, -0.2, 0.0], [0.3, 0.2, 0.5]), within];
    let cloud = evenly(&object, &Even { views: 1, points: 20_000, noise: 0.0 }, &mut Random::new(5, "block"));
    assert_eq!(cloud.points.len(), 20_000);
    let places: Vec<Point3<f64>> = cloud.points.iter().map(|p| cloud.X_WF.inverse() * p).collect();
    let on = |f: &dyn Fn(&Point3<f64>) -> bool, area: f64| places.iter().filter(|p| f(p)).count() as f64 / area;
    let (front, top) = (on(&|p| p.x > 0.3 - 1e-9, 0.4 * 0.5), on(&|p| p.z > 0.5 - 1e-9, 0.6 * 0.4));
    assert!((front / top - 1.0).abs() < 0.1, "{front} and {top} points a square metre");
    assert!(places.iter().all(|p| p.x > -0.3 + 1e-9 && p.z > 1e-9), "a side that is turned away is seen");
}

#[test]
fn the_same_seed_gives_the_same_cloud() {
    let draw = || {
        let mut random = Random::new(3, "again");
        let object = FAMILIES[0].draw(&mut random);
        let how = Look::draw(&mut random);
        look(&object, &how, &mut random).points
    };
    assert_eq!(draw(), draw());
}

#[test]
fn noise_grows_with_distance() {
    // A wall before the camera, near and far.
    let spread = |distance: f64| {
        let mut object = FAMILIES[0].draw(&mut Random::new(1, "wall"));
        object.joints.clear();
        object.parts.truncate(1);
        object.parts[0].solids = vec![sagci_furniture::Solid::between([-0.1, -5.0, -5.0], [0.0, 5.0, 5.0])];
        let camera = Camera::looking(Point3::new(distance, 0.0, 0.0), Point3::origin(), 60, 45, 60.0);
        let image = cast(&camera, &object, &Isometry3::identity(), &[]);
        assert!(image.iter().all(|h| (h.unwrap().depth - distance).abs() < 1e-9));
        let noise = Noise { axial: 0.0005, axial_square: 0.0015, ..Noise::NONE };
        let how = Look { noise, ..exact(1) };
        let mut random = Random::new(2, "noise");
        let cloud = look(&object, &how, &mut random);
        let d: Vec<f64> = cloud.points.iter().map(|p| (cloud.X_WF.inverse() * p).x).collect();
        (cloud.cameras[0].X_WC.translation.vector.norm(), (d.iter().map(|x| x * x).sum::<f64>() / d.len() as f64).sqrt())
    };
    let (_, s) = spread(1.0);
    assert!((0.0002..0.05).contains(&s), "{s}");
    let _: Vector3<f64> = Vector3::zeros();
}
