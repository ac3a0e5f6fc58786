% By hand: ISETCam under Octave opens the scene and the optical image of one capture.
%
%     fluorspar cube RUN --capture blue --out scene.mat; fluorspar cube RUN --capture blue --out scene.npy
%     fluorspar cube RUN --capture blue --on-film --out oi.mat; fluorspar cube RUN --capture blue --on-film --out oi.npy
%     octave-cli validation/check_iset.m ISETCAM FOLDER
%
% ISETCAM is a checkout of the toolbox, FOLDER holds the four files. Ends with an error where its numbers are not those of the program.
1;

function cube = read_npy(path)
  file = fopen(path, 'r', 'ieee-le');
  head = fread(file, 10, 'uint8');
  text = fread(file, head(9) + 256 * head(10), 'char=>char')';
  shape = sscanf(regexp(text, '\(([^)]*)\)', 'tokens'){1}{1}, '%d,')';
  cube = permute(reshape(fread(file, prod(shape), 'single'), fliplr(shape)), [3 2 1]);
  fclose(file);
end

function same(what, found, expected, tolerance)
  error_ = max(abs(double(found(:)) - double(expected(:)))) / max(abs(double(expected(:))));
  printf('%-38s %g\n', [what ', relative difference'], error_);
  assert(isequal(size(found), size(expected)) && error_ <= tolerance, what);
end

arguments = argv();
[toolbox, folder] = arguments{1:2};
warning('off', 'all');
addpath(genpath(toolbox));

scene = load(fullfile(folder, 'scene.mat')).scene;
radiance = read_npy(fullfile(folder, 'scene.npy'));
wave = sceneGet(scene, 'wave');
% The toolbox has Planck's constant as it was in 1973, 1.6e-5 larger
same('radiance of the scene', sceneGet(scene, 'energy'), radiance, 2e-5);
% 683 lm/W times the efficiency of the eye, with the bands of the scene
eye = ieReadSpectra('luminosity', wave);
luminance = 683 * reshape(radiance, [], numel(wave)) * eye(:) * (wave(2) - wave(1));
same('mean luminance', sceneGet(scene, 'mean luminance'), mean(luminance), 1e-4);
printf('field %g degrees, distance %g m\n', sceneGet(scene, 'fov'), sceneGet(scene, 'distance'));
assert(sceneGet(scene, 'fov') > 0 && sceneGet(scene, 'distance') > 0);

oi = load(fullfile(folder, 'oi.mat')).oi;
irradiance = read_npy(fullfile(folder, 'oi.npy'));
same('irradiance of the optical image', Quanta2Energy(oiGet(oi, 'wave'), oiGet(oi, 'photons')), irradiance, 2e-5);
illuminance = 683 * reshape(irradiance, [], numel(wave)) * eye(:) * (wave(2) - wave(1));
same('mean illuminance', oiGet(oi, 'mean illuminance'), mean(illuminance), 1e-4);
printf('optical image of %g mm\n', 1e3 * oiGet(oi, 'width'));
