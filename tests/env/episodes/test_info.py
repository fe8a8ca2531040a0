"""Tests of what is told of episodes that ended."""

import numpy as np

from thalweg.env.episodes.info import final_info_of


def test_the_last_observations_and_infos_go_to_the_rows_that_ended():
    info = {"cost": np.array([1.0, 2.0, 3.0]), "pose": np.arange(6.0).reshape(3, 2)}
    ended = np.array([True, False, True])
    batch = np.array([[10], [11], [12], [20], [22]])  # three new observations, then the last ones of rows 0 and 2
    final = final_info_of(info, batch, ended)
    assert [None if row is None else row.tolist() for row in final["final_obs"]] == [[20], None, [22]]
    assert final["final_info"]["cost"].tolist() == [1.0, 0.0, 3.0]
    assert final["final_info"]["pose"].tolist() == [[0.0, 1.0], [0.0, 0.0], [4.0, 5.0]]
    assert final["_final_obs"].tolist() == final["_final_info"].tolist() == ended.tolist()


def test_what_is_told_does_not_change_with_the_environment():
    info, ended = {"cost": np.array([1.0])}, np.array([True])
    final = final_info_of(info, np.array([[1], [2]]), ended)
    info["cost"][0], ended[0] = 5.0, False
    assert final["final_info"]["cost"].tolist() == [1.0] and final["_final_obs"].tolist() == [True]
