/// A figure with its unit, for example a joint's position.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What it is, for example `door`.
    pub name: String,
    /// Its value, SI.
    pub value: f64,
    /// Its unit: `rad`, `m`, `N`, `s`.
    pub unit: String,
}

/// One figure as it was predicted and as it was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// What it is.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// What was predicted; nothing if nobody did.
    pub predicted: Option<f64>,
    /// What was measured; nothing if nobody did.
    pub measured: Option<f64>,
}

impl Gap {
    /// Measured less predicted, in the figure's unit.
    pub fn difference(&self) -> Option<f64> {
        self.measured.zip(self.predicted).map(|(m, p)| m - p).filter(|d| d.is_finite())
    }

    /// The difference as a fraction of the predicted value's size; nothing where that is zero.
    pub fn relative(&self) -> Option<f64> {
        let size = self.predicted?.abs();
        self.difference().filter(|_| size > 0.0).map(|d| d / size)
    }
}

/// Sets predicted and measured figures side by side, by name and unit: those that were predicted in their order, then
/// those that were only measured. A figure of the same name and another unit is another figure.
pub fn gaps(predicted: &[Figure], measured: &[Figure]) -> Vec<Gap> {
    let same = |a: &Figure, b: &Figure| a.name == b.name && a.unit == b.unit;
    let mut taken = vec![false; measured.len()];
    let mut all: Vec<Gap> = Vec::with_capacity(predicted.len().max(measured.len()));
    for p in predicted {
        let found = measured.iter().enumerate().position(|(i, m)| !taken[i] && same(p, m));
        if let Some(i) = found {
            taken[i] = true;
        }
        all.push(Gap { name: p.name.clone(), unit: p.unit.clone(), predicted: Some(p.value), measured: found.map(|i| measured[i].value) });
    }
    for (m, _) in measured.iter().zip(&taken).filter(|(_, taken)| !**taken) {
        all.push(Gap { name: m.name.clone(), unit: m.unit.clone(), predicted: None, measured: Some(m.value) });
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(name: &str, value: f64, unit: &str) -> Figure {
        Figure { name: name.into(), value, unit: unit.into() }
    }

    #[test]
    fn figures_meet_by_name_and_unit_and_none_is_lost() {
        let predicted = [figure("door", 1.4, "rad"), figure("force", 0.0, "N"), figure("time", 5.0, "s")];
        let measured = [figure("time", 6.0, "s"), figure("door", 1.3, "rad"), figure("door", 0.2, "m"), figure("force", 3.0, "N")];
        let all = gaps(&predicted, &measured);
        let names: Vec<_> = all.iter().map(|g| (g.name.as_str(), g.unit.as_str())).collect();
        assert_eq!(names, [("door", "rad"), ("force", "N"), ("time", "s"), ("door", "m")]);
        assert!(all[0].difference().is_some_and(|d| (d + 0.1).abs() < 1e-12));
        assert!(all[0].relative().is_some_and(|d| (d + 0.1 / 1.4).abs() < 1e-12));
        assert_eq!((all[1].difference(), all[1].relative()), (Some(3.0), None));
        assert_eq!((all[3].predicted, all[3].difference()), (None, None));
    }

    #[test]
    fn a_figure_that_is_no_number_has_no_difference() {
        let all = gaps(&[figure("door", f64::NAN, "rad")], &[figure("door", 1.0, "rad")]);
        assert_eq!((all[0].difference(), all[0].relative()), (None, None));
    }
}
