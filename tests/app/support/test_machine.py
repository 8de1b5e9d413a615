"""Limits of a container or a job, in both versions of control groups."""

from __future__ import annotations

import os

import pytest

from layflat.app.support import machine

GB = 10**9
PHYSICAL = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


@pytest.fixture
def group(tmp_path, monkeypatch):
    """``group(membership, **{path: content})``: control groups of a machine with 8 cores."""
    monkeypatch.setattr(machine, "GROUPS", tmp_path)
    monkeypatch.setattr(machine, "MEMBERSHIP", tmp_path / "membership")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))

    def make(membership: str, files: dict[str, str]) -> None:
        (tmp_path / "membership").write_text(membership)
        for name, content in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content + "\n")

    return make


def test_no_limit(group):
    group("0::/\n", {"cpu.max": "max 100000", "memory.max": "max"})
    assert (machine.available_cores(), machine.memory_bytes(), machine.memory_limit_bytes()) == (8, PHYSICAL, None)


def test_version_2_takes_the_smallest_limit_on_the_way_up(group):
    job = "system.slice/job"
    group(
        f"0::/{job}\n",
        {
            "system.slice/cpu.max": "250000 100000",
            f"{job}/cpu.max": "max 100000",
            f"{job}/memory.max": str(2 * GB),
            "system.slice/memory.max": str(GB),
        },
    )
    assert (machine.available_cores(), machine.memory_limit_bytes()) == (3, GB)
    assert machine.default_workers() == 3


def test_version_1_in_a_container_that_sees_its_own_group_as_the_outermost(group):
    group(
        "9:name=systemd:/\n4:memory:/docker/abc\n2:cpuacct,cpu:/docker/abc\n0::/docker/abc\n",
        {
            "memory/memory.limit_in_bytes": str(GB // 2),
            "cpu/cpu.cfs_quota_us": "150000",
            "cpu/cpu.cfs_period_us": "100000",
        },
    )
    assert (machine.available_cores(), machine.memory_limit_bytes()) == (2, GB // 2)
    assert machine.default_workers() == 1


def test_version_1_without_limits(group):
    huge = "9223372036854771712"
    group(
        "4:memory:/\n2:cpu:/\n",
        {"memory/memory.limit_in_bytes": huge, "cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"},
    )
    assert (machine.available_cores(), machine.memory_limit_bytes()) == (8, None)


@pytest.mark.parametrize("limit", [1, 100_000_000, 400_000_000])
def test_there_is_always_a_worker(group, limit):
    group("0::/\n", {"memory.max": str(limit), "cpu.max": "1000 100000"})
    assert (machine.available_cores(), machine.default_workers()) == (1, 1)


def test_this_machine_has_at_least_a_core_and_some_memory():
    assert 1 <= machine.available_cores() <= (os.cpu_count() or 1)
    assert 0 < (machine.memory_bytes() or 0) <= PHYSICAL
