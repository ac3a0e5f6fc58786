//! `fluorspar tissue depth`.

use fluorspar_session::tissue::LightOrigins;

use crate::commands::table::{align, short};

pub(super) fn describe(LightOrigins { title, light, channels: origins }: &LightOrigins) -> String {
    let mut head: Vec<String> = ["channel", "mean, um", "5 %", "50 %", "90 %"].map(String::from).to_vec();
    head.extend(
        origins.first().into_iter().flat_map(|origin| origin.layers.iter().map(|(name, _)| name.clone())),
    );
    let mut rows = vec![head];
    for origin in origins {
        let cell = |depth: Option<f64>| depth.map_or_else(|| "-".into(), short);
        let depths = [origin.mean_depth_um, origin.depth_5_um, origin.depth_50_um, origin.depth_90_um];
        let mut row = vec![origin.channel.clone()];
        row.extend(depths.map(cell));
        row.extend(origin.layers.iter().map(|(_, share)| format!("{:.0} %", 100.0 * share)));
        rows.push(row);
    }
    format!(
        "{title}: where the fluorescence of each channel arises under {light}\n\
         Depths, um, above which that share of the light arises; shares by layer\n\n{}",
        align(&rows, &[])
    )
}
