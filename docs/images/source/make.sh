#!/bin/sh
# Makes the pictures of docs/images, or of the folder IMAGES; see README.md beside this file.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
images=${IMAGES:-$root/docs/images}
fluorspar=${FLUORSPAR:-$root/target/release/fluorspar}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ $# -gt 0 ] || set -- main views lesions restorations masks scan gallery tissue design

# Frames of an experiment as NAME_white.png and NAME_blue.png in the folder of work: EXPERIMENT NAME SAMPLES
frames() {
    "$fluorspar" run "$1" --out "$work/$2" --spp "$3" --quiet
    for frame in white blue; do
        cp "$work/$2/preview_$frame.png" "$work/$2_$frame.png"
        python3 "$here/shrink_png.py" "$work/$2_$frame.png" 64 --half
    done
}

# Frames of an experiment as gallery_NAME_FRAME.png in the folder of work: EXPERIMENT NAME OPTIONS
gallery_frames() {
    experiment=$1 picture=$2
    shift 2
    "$fluorspar" run "$experiment" --out "$work/$picture" --spp 64 --quiet "$@" >/dev/null
    for frame in "$work/$picture"/preview_*.png; do
        cp "$frame" "$work/gallery_${picture}_$(basename "$frame" .png | cut -d_ -f2-).png"
    done
}

for name in "$@"; do
    case $name in
    main)
        frames oraleye-2021 main 64
        cp "$work/main_white.png" "$images/white.png"
        cp "$work/main_blue.png" "$images/blue.png"
        "$fluorspar" run oraleye-2021 --out "$work/default" --quiet
        cp "$work/default/figures/chromaticity.png" "$images/chromaticity.png"
        ;;
    views)
        "$fluorspar" mouth view --width 192 --spp 16 --out "$work/mouth_views.png" --quiet
        python3 "$here/shrink_png.py" "$work/mouth_views.png" 24
        cp "$work/mouth_views.png" "$images"
        ;;
    lesions)
        frames "$here/lesions.toml" lesions 24
        cp "$work/lesions_white.png" "$work/lesions_blue.png" "$images"
        ;;
    restorations)
        frames "$here/restorations.toml" restorations 24
        cp "$work/restorations_white.png" "$work/restorations_blue.png" "$images"
        ;;
    masks)
        cp "$here/masks.toml" "$work"
        python3 "$here/paint_masks.py" "$work"
        frames "$work/masks.toml" masks 24
        cp "$work/masks_white.png" "$work/masks_blue.png" "$images"
        ;;
    scan)
        cp "$here/scan.toml" "$work"
        "$fluorspar" mouth generate --set jaw_opening_mm=37 --set tooth_irregularity=2.5 --set seed=7 \
            --out "$work/model.obj"
        python3 "$here/scanner_frame.py" "$work/model.obj" "$work/teeth.stl" 'tooth_1*' 'tooth_2*' --chip tooth_11
        python3 "$here/scanner_frame.py" "$work/model.obj" "$work/gums.ply" upper_gingiva
        frames "$work/scan.toml" scan 24
        cp "$work/scan_white.png" "$images"
        ;;
    gallery)
        examples=$root/examples
        for template in leaf painting cuvette; do
            "$fluorspar" new "$template" "$work/$template.toml" --quiet
            gallery_frames "$work/$template.toml" "$template" --set render.width_px=320 --set render.height_px=240
        done
        gallery_frames "$examples/09-dilution-series.toml" dilution --set render.width_px=320 --set render.height_px=160
        gallery_frames "$examples/10-banknote.toml" banknote --set render.width_px=320 --set render.height_px=200
        "$fluorspar" render fluorescent-sphere --spp 64 --out "$work/spheres.npy" --preview "$work/gallery_spheres.png" --quiet
        "$fluorspar" catalog plot fluorophore quinine_sulfate fluorescein rhodamine_6g protoporphyrin_ix_in_tissue \
            --out "$work/gallery_dyes.png" --quiet
        "$fluorspar" plot --light led_405 --light-filter short_pass_450 --fluorophore riboflavin \
            --fluorophore protoporphyrin_ix_in_tissue --view-filter long_pass_475 --qe consumer_rgb_cmos \
            --out "$work/gallery_chain.png" --quiet
        "$fluorspar" lens report double_gauss_100mm --out "$work/gallery_lens.svg" --quiet >/dev/null
        "$fluorspar" scene view oraleye-2021 --show part --width 320 --out "$work/gallery_parts.png" --quiet >/dev/null
        for picture in "$work"/gallery_*_*.png "$work/gallery_spheres.png"; do
            python3 "$here/shrink_png.py" "$picture" 32
        done
        cp "$work"/gallery_*.png "$work/gallery_lens.svg" "$images"
        ;;
    tissue)
        "$fluorspar" tissue solve dorsal_tongue --light led_405 --out "$work/tongue" --quiet >/dev/null
        cp "$work/tongue/fluorescence_led_405.png" "$images/tissue-fluorescence.png"
        "$fluorspar" tissue depth dorsal_tongue --view-filter long_pass_475 --out "$images/tissue-depth.png" --quiet >/dev/null
        ;;
    design)
        "$fluorspar" design optimize two-lights-tissue --out "$work/design" --quiet >/dev/null
        for picture in spectra lights; do
            cp "$work/design/$picture.svg" "$images/design-$picture.svg"
        done
        cp "$work/design/designs.svg" "$images/design-front.svg"
        ;;
    *)
        echo "no pictures named $name; there are: main views lesions restorations masks scan gallery tissue design" >&2
        exit 2
        ;;
    esac
done
