use nalgebra::{Isometry3, Point3};

use crate::frame::Frame;
use crate::locate::{frames, locate_in};
use crate::surface::Surface;
use crate::{Freedom, Located, PerceptionError, Place, Prior, Request, SceneRequest, View};

/// Finds several objects: the largest first, and those inside another after it. Points that one object explains are taken
/// out before the next is looked for. The answers stand in the order of the requests.
///
/// # Errors
/// An error of the images fails the whole; an error of one object is its own answer.
pub fn locate_scene(
    views: &[View],
    table_height: f64,
    requests: &[SceneRequest<'_>],
) -> Result<Vec<Result<Located, PerceptionError>>, PerceptionError> {
    let (mut frames, mut mount) = frames(views, table_height)?;
    let sizes: Vec<f64> = requests.iter().map(|r| Surface::of(r.model).area).collect();
    let mut waiting: Vec<usize> = (0..requests.len()).collect();
    waiting.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]).then(a.cmp(b)));
    let mut answers: Vec<Option<Result<Located, PerceptionError>>> = vec![None; requests.len()];
    while !waiting.is_empty() {
        let ready = waiting.iter().position(|&i| match &requests[i].place {
            Place::Prior(_) => true,
            Place::Inside { object, .. } => requests.iter().position(|r| r.name == *object).is_none_or(|host| answers[host].is_some()),
        });
        // Objects inside one another in a ring never become ready: the first of them is answered with the reason.
        let i = waiting.remove(ready.unwrap_or(0));
        let answer = prior(requests, &answers, i).and_then(|prior| {
            let r = &requests[i];
            let request = Request { name: &r.name, model: r.model, prior, freedom: r.freedom, q: r.q.clone(), joints: r.joints.clone() };
            if r.freedom == Freedom::Held && r.joints.is_empty() {
                return Ok(None);
            }
            locate_in(&frames, &mount, &request).map(Some)
        });
        answers[i] = Some(match answer {
            Ok(Some((located, explained))) => {
                for frame in &mut frames {
                    frame.correct(&explained.X_CD);
                    frame.keep(|p| !explained.covers(p));
                }
                mount = explained.mount.unwrap_or(mount);
                Ok(located)
            }
            Ok(None) => held(&requests[i]),
            Err(e) => Err(e),
        });
    }
    Ok(answers.into_iter().flatten().collect())
}

/// Points in the world that belong neither to the table nor to a body that their view knows: what nobody has told of. The cameras are set
/// right by the table first.
///
/// # Errors
/// No image, or one that cannot be used.
pub fn unexplained(views: &[View], table_height: f64) -> Result<Vec<Point3<f64>>, PerceptionError> {
    let (frames, _) = frames(views, table_height)?;
    let points = |f: &Frame| -> Vec<Point3<f64>> {
        let at = |i: usize| f.X_WC * Point3::from(f.ray_C((i % f.width) as f64, (i / f.width) as f64) * f.depth[i]);
        (0..f.open.len()).filter(|i| f.open[*i]).map(at).collect()
    };
    Ok(frames.iter().flat_map(points).collect())
}

/// An object that is held and of which nothing is asked is where it is said to be.
fn held(request: &SceneRequest<'_>) -> Result<Located, PerceptionError> {
    match &request.place {
        Place::Prior(Prior::Near { X_WO, .. }) => Ok(Located {
            X_WO: *X_WO,
            q: request.q.clone(),
            covariance: nalgebra::Matrix6::identity() * 1e-6,
            q_deviation: vec![0.0; request.q.len()],
            residual_rms: 0.0,
            inlier_share: 0.0,
            violated_share: 0.0,
            visible_share: 0.0,
            pixels: 0,
            rivals: 1,
        }),
        _ => Err(PerceptionError::Request { object: request.name.clone(), message: "is held, but no pose is given".into() }),
    }
}

fn prior(requests: &[SceneRequest<'_>], answers: &[Option<Result<Located, PerceptionError>>], i: usize) -> Result<Prior, PerceptionError> {
    let refuse = |message: String| PerceptionError::Request { object: requests[i].name.clone(), message };
    let (object, region) = match &requests[i].place {
        Place::Prior(prior) => return Ok(prior.clone()),
        Place::Inside { object, region } => (object, region),
    };
    let host = requests
        .iter()
        .position(|r| r.name == *object)
        .ok_or_else(|| refuse(format!("is said to be inside '{object}', which is not among the objects to locate")))?;
    let located = match &answers[host] {
        Some(Ok(located)) => located,
        Some(Err(_)) => return Err(refuse(format!("is inside '{object}', which was not located"))),
        None => return Err(refuse(format!("is inside '{object}', which is inside it in turn"))),
    };
    let model = requests[host].model;
    let place = match region {
        Some(name) => model.document.regions.iter().find(|r| r.name == *name),
        None => model.document.regions.first(),
    }
    .ok_or_else(|| {
        refuse(format!(
            "is said to be in the region '{}' of '{object}', which has none of that name",
            region.as_deref().unwrap_or("(first)")
        ))
    })?;
    let link = model.link(&place.link).ok_or_else(|| refuse(format!("region '{}' is fixed to no link of '{object}'", place.name)))?;
    let [x, y, z] = place.center;
    let X_WG = located.X_WO * model.X_OL(&located.q)[link] * Isometry3::translation(x, y, z);
    Ok(Prior::Region { X_WG, size: place.size })
}
