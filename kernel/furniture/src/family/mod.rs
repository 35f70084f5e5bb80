//! Families: ways of building a category.

mod chest;
mod cold;
mod composed;
mod divided;
mod entrance;
mod kitchen;
mod passage;
mod still;
mod storage;

use crate::front::Builder;
use crate::object::{Category, Object};
use crate::random::Random;

/// One way of building a category.
pub struct Family {
    /// Its name.
    pub name: &'static str,
    /// What it builds.
    pub category: Category,
    /// Is it kept out of training?
    pub held_out: bool,
    /// How often training draws it where a plain family is drawn once: one that holds many kinds is drawn more often.
    pub weight: usize,
    build: fn(&mut Builder<'_>),
}

impl Family {
    /// An object of the family.
    pub fn draw(&self, random: &mut Random) -> Object {
        let mut builder = Builder::new(random);
        (self.build)(&mut builder);
        builder.finish(self.category, self.name)
    }
}

const fn known(category: Category, name: &'static str, build: fn(&mut Builder<'_>)) -> Family {
    Family { name, category, held_out: false, weight: 1, build }
}

const fn varied(category: Category, name: &'static str, build: fn(&mut Builder<'_>)) -> Family {
    Family { weight: 3, ..known(category, name, build) }
}

const fn held_out(category: Category, name: &'static str, build: fn(&mut Builder<'_>)) -> Family {
    Family { name, category, held_out: true, weight: 1, build }
}

/// All families.
pub const FAMILIES: &[Family] = &[
    known(Category::Box, "flat_lid", chest::flat_lid),
    known(Category::Box, "deep_lid", chest::deep_lid),
    known(Category::Box, "carton_four_flaps", chest::carton_four_flaps),
    known(Category::Box, "front_flap_box", chest::front_flap_box),
    known(Category::Box, "rimmed_lid", chest::rimmed_lid),
    known(Category::Box, "slab_lid", chest::slab_lid),
    known(Category::Box, "bench", composed::bench),
    held_out(Category::Box, "casket", chest::casket),
    held_out(Category::Box, "carton_two_flaps", chest::carton_two_flaps),
    known(Category::Door, "single_in_frame", entrance::single_in_frame),
    known(Category::Door, "double_in_frame", entrance::double_in_frame),
    known(Category::Door, "in_wall", entrance::in_wall),
    known(Category::Door, "sliding_before_wall", entrance::sliding_before_wall),
    known(Category::Door, "under_transom", entrance::under_transom),
    known(Category::Door, "unequal_leaves", entrance::unequal_leaves),
    known(Category::Door, "hatch_over_counter", entrance::hatch_over_counter),
    known(Category::Door, "sash_window", entrance::sash_window),
    known(Category::Door, "sliding_panes", entrance::sliding_panes),
    known(Category::Door, "gate", passage::gate),
    known(Category::Door, "casement", passage::casement),
    known(Category::Door, "wall_hatch", passage::wall_hatch),
    known(Category::Door, "stalls", passage::stalls),
    known(Category::Door, "glazed_screen", composed::glazed_screen),
    known(Category::Door, "shutters", composed::shutters),
    known(Category::Door, "panelled_wall", composed::panelled_wall),
    varied(Category::Door, "divided_doorway", divided::divided_doorway),
    varied(Category::Door, "divided_hatches", divided::divided_hatches),
    held_out(Category::Door, "with_sidelight", entrance::with_sidelight),
    held_out(Category::Door, "stable_door", entrance::stable_door),
    known(Category::Microwave, "side_door_with_panel", kitchen::side_door_with_panel),
    known(Category::Microwave, "panel_set_back", kitchen::panel_set_back),
    known(Category::Microwave, "full_width_door", kitchen::full_width_door),
    known(Category::Microwave, "panel_below", kitchen::panel_below),
    known(Category::Microwave, "machine", composed::machine),
    held_out(Category::Microwave, "knobs_beside", kitchen::knobs_beside),
    held_out(Category::Microwave, "drop_door", kitchen::drop_door),
    known(Category::Oven, "built_in", kitchen::built_in_oven),
    known(Category::Oven, "cooker_with_drawer", kitchen::cooker_with_drawer),
    known(Category::Oven, "double_oven", kitchen::double_oven),
    known(Category::Oven, "any_cooker", kitchen::any_cooker),
    known(Category::Oven, "wide_range", composed::wide_range),
    held_out(Category::Oven, "range_with_splashback", kitchen::range_with_splashback),
    held_out(Category::Oven, "side_hinged_oven", kitchen::side_hinged_oven),
    known(Category::Refrigerator, "one_door", cold::one_door),
    known(Category::Refrigerator, "freezer_on_top", cold::freezer_on_top),
    known(Category::Refrigerator, "side_by_side", cold::side_by_side),
    known(Category::Refrigerator, "french_doors", cold::french_doors),
    known(Category::Refrigerator, "any_rows", cold::any_rows),
    known(Category::Refrigerator, "cold_store", composed::cold_store),
    held_out(Category::Refrigerator, "freezer_below", cold::freezer_below),
    held_out(Category::Refrigerator, "four_doors", cold::four_doors),
    known(Category::Storage, "chest_of_drawers", storage::chest_of_drawers),
    known(Category::Storage, "wardrobe", storage::wardrobe),
    known(Category::Storage, "mixed_grid", storage::mixed_grid),
    known(Category::Storage, "wall_cabinet", storage::wall_cabinet),
    known(Category::Storage, "desk", storage::desk),
    known(Category::Storage, "open_shelves", storage::open_shelves),
    known(Category::Storage, "tall_unit", storage::tall_unit),
    known(Category::Storage, "sliding_fronts", storage::sliding_fronts),
    known(Category::Storage, "stout_drawers", storage::stout_drawers),
    known(Category::Storage, "panel_before_case", storage::panel_before_case),
    known(Category::Storage, "lockers", composed::lockers),
    known(Category::Storage, "larder", composed::larder),
    known(Category::Storage, "kitchen_run", composed::kitchen_run),
    held_out(Category::Storage, "sideboard", storage::sideboard),
    held_out(Category::Storage, "nightstand", storage::nightstand),
    held_out(Category::Storage, "shoe_cabinet", storage::shoe_cabinet),
];

/// Things without a moving part. Their category says no more than which furniture they are taken for most easily.
pub const STILL: &[Family] = &[
    known(Category::Storage, "table", still::table),
    known(Category::Storage, "bookcase", still::bookcase),
    known(Category::Box, "crate_or_block", still::crate_or_block),
    known(Category::Box, "turned_pieces", still::turned_pieces),
    varied(Category::Box, "parcel", still::parcel),
    varied(Category::Box, "blocks", still::blocks),
    held_out(Category::Storage, "chair", still::chair),
    held_out(Category::Box, "vessel", still::vessel),
];

/// The families of a category, either those for training or those held out.
pub fn families(category: Category, held_out: bool) -> Vec<&'static Family> {
    FAMILIES.iter().filter(|f| f.category == category && f.held_out == held_out).collect()
}
