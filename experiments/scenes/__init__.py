"""Scenes: the built-in ones, and loading and checking whatever a user brings."""

from __future__ import annotations

from experiments.scenes.catalogue import BUILT_IN as BUILT_IN
from experiments.scenes.catalogue import SceneEntry as SceneEntry
from experiments.scenes.catalogue import describe as describe
from experiments.scenes.loading import LoadedScene as LoadedScene
from experiments.scenes.loading import load_scene as load_scene
from experiments.scenes.loading import scene_file_name as scene_file_name
