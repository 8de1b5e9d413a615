"""The field of a model that is drawn beside its demonstrations."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.app.report.attractor_field import field_figure, vector_field


@pytest.fixture(scope="module")
def demonstrations(make_episode):
    return [make_episode(robot="pickers", source="scripted", disturbed=False, seed=seed) for seed in range(2)]


@pytest.fixture(scope="module")
def model(make_model, demonstrations):
    return make_model("pickers", "all", demonstrations)


def test_the_field_is_the_prediction_at_the_cloth_state_of_nearby_demonstrations(model, demonstrations):
    inputs = []

    class Spy:
        layout = model.layout

        def predict(self, given):
            inputs.append(given)
            return model.predict(given)

    field = vector_field(Spy(), demonstrations)
    names = model.layout.names
    mean, std = model.predict(inputs[0])
    plane = inputs[0][:, [names.index("x1"), names.index("z1")]]
    np.testing.assert_allclose(plane, np.column_stack([field.x.ravel(), field.z.ravel()]))
    np.testing.assert_allclose(field.dx.ravel(), mean[:, 0])
    np.testing.assert_allclose(field.dz.ravel(), mean[:, 2])
    np.testing.assert_allclose(field.std.ravel() ** 2, (std[:, [0, 2]] ** 2).mean(axis=1))
    known = np.concatenate([model.layout.matrix(episode.steps) for episode in demonstrations])
    for name in ("y2", "contact"):
        column = names.index(name)
        assert known[:, column].min() - 1e-9 <= inputs[0][:, column].min()
        assert inputs[0][:, column].max() <= known[:, column].max() + 1e-9
    places = known[:, [names.index("x1"), names.index("z1")]]
    nearest = np.linalg.norm(plane[:, None] - places[None], axis=2).min(axis=1)
    np.testing.assert_allclose(field.distance.ravel(), nearest)


def test_the_figure_has_a_panel_for_each_model(model, demonstrations):
    for models in ({"gp-word": model}, {"gp-baseline": model, "gp-word": model}):
        figure = field_figure(models, demonstrations)
        assert len(figure.panels) == len(models)
        assert all(name in panel for name, panel in zip(models, figure.panels, strict=True))
        assert all(panel.count("var(--ink)") > 400 for panel in figure.panels), "an arrow each point of the grid"
        assert "2 demonstrations" in figure.caption
        assert [key.name.split(",")[0] for key in figure.legend] == ["2 demonstrations", "end", "standard deviation"]


def test_a_held_contact_adds_a_panel_to_the_models_that_see_it(make_model, model, demonstrations):
    baseline = make_model("pickers", "position", demonstrations)
    held = vector_field(model, demonstrations, contact=0.5)
    free = vector_field(model, demonstrations)
    np.testing.assert_array_equal(held.x, free.x)
    assert np.abs(held.dx - free.dx).max() > 1e-6
    alike = field_figure({"gp-baseline": baseline}, demonstrations)
    assert field_figure({"gp-baseline": baseline}, demonstrations, contact=0.5) == alike
    assert "50 % flat" in field_figure({"gp-word": model}, demonstrations, contact=0.5).caption
