"""Assembly of a robot: localisation, navigation and behaviour from its set-up."""

from contextlib import nullcontext
from types import MappingProxyType
from typing import Annotated, Final

import msgspec

from actors.floor import raster
from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose, wrap
from actors.items import plain_items
from actors.portable import arrays, draws, foundations
from actors.randomness import generator
from actors.robot import localisation
from actors.robot.behaviour.adversary import adversary
from actors.robot.behaviour.handover import behaviour_of
from actors.robot.behaviour.ports import Start
from actors.robot.core import RobotCore, RobotParts
from actors.robot.introspector import Introspector
from actors.robot.localisation import Amcl, DeadReckoning, LikelihoodField, Localisation, likelihood_field
from actors.robot.navigation import cost_map, disc_dwa, dwa, local_planner, map_grid, potential, ray_tracing
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.disc_local_planner import DiscLocalPlanner
from actors.robot.navigation.local_planner import DwaLocalPlanner
from actors.robot.navigation.navfn import GlobalCosts, NavfnPlanner, global_costs
from actors.robot.navigation.navigator import Navigator
from actors.robot.navigation.planning import GlobalPlanner, GridPlanner, PlanningGrid, planning_grid
from actors.robot.navigation.routes import ReachableFloor
from actors.robot.navigation.steering import BaseLocalPlanner
from actors.robot.stack import Adaptation, Stack
from actors.robot.sweep import OdometryBuffer
from actors.robot_model import AdversaryKind, RobotDescription, RobotModel
from actors.runtime.process_setup import RecordDetail
from actors.runtime.processor import fingerprints
from actors.settings import Count
from deeco.node import observing_nodes

KERNELS: Final = (
    *(foundations, arrays, draws, raster, potential, ray_tracing, cost_map, map_grid, local_planner),
    *(dwa, disc_dwa, *localisation.KERNELS),
)


class RobotSetup(RobotDescription, frozen=True, kw_only=True):
    """Complete description of a robot, independent of its process.

    Paths are absolute or relative to the folder of the set-up.
    """

    epoch: Count
    """Number of restarts."""
    first_step: Count
    seed: Count
    """Seed of this robot; the run's seed and the scenario would reveal the positions of its peers."""
    step_us: Annotated[int, msgspec.Meta(ge=1)]
    address: Count
    """Address on the radio."""
    members: tuple[tuple[str, Count], ...] = ()
    """Id and radio address of every robot of the run, this one included; empty in earlier versions."""
    behaviour: str
    """Entry string `module:function`."""
    adversary: AdversaryKind | None = None
    map: str = "map.yaml"
    """Path of the floor plan."""
    adaptation: Adaptation = Adaptation()
    stack: Stack = Stack()
    doubt: Annotated[float, msgspec.Meta(gt=0, le=100)] | None = None
    """Standard deviation of `start`, m and rad; the robot stands until located. None: exact."""
    detail: RecordDetail = "lean"
    """Level of detail of the recording."""
    key_file: str | None = None
    """File in the robot's folder with `adaptation.exchange.key`, which is not recorded; None: no file."""

    @property
    def pose(self) -> Pose:
        """Start pose."""
        x, y, heading = self.start
        return Pose(x, y, wrap(heading))


class SharedMapData(msgspec.Struct, frozen=True, eq=False):
    """Data derived from map, model and stack, shared by all robots with equal ones."""

    plan: OccupancyGrid
    floor: PlanningGrid
    field: LikelihoodField | None
    """None without localisation."""
    costs: GlobalCosts | None
    """None unless the planner is navfn."""


def shared_map_data(plan: OccupancyGrid, model: RobotModel, stack: Stack) -> SharedMapData:
    """Return the data shared by robots of this model and stack; cached weakly (`SharedCache`)."""
    field, costs = None, None
    if stack.localisation is not None:
        field = likelihood_field(plan, stack.localisation.max_distance)
    if stack.planner.method == "navfn":
        costs = global_costs(plan, model.footprint.circumradius, stack.planner)
    return SharedMapData(plan, floor(plan, model, stack), field, costs)


def floor(plan: OccupancyGrid, model: RobotModel, stack: Stack) -> PlanningGrid:
    """Return the floor plan for the model's body; may be shared by all robots of a process."""
    return planning_grid(plan, model.footprint.circumradius, stack.planner)


def start(setup: RobotSetup, model: RobotModel, floor: PlanningGrid) -> Start:
    """Return the initial data of the robot's behaviour."""
    own, adaptation = generator(setup.seed, "behaviour", setup.id, setup.epoch), setup.adaptation
    return Start(
        robot=setup.id,
        address=setup.address,
        epoch=setup.epoch,
        pose=setup.pose,
        items=plain_items(setup.items),
        generator=own,
        settings=MappingProxyType(dict(adaptation.settings)),
        exchange=adaptation.exchange,
        floor=ReachableFloor(floor, model.footprint.circumradius, setup.pose.point, adaptation.areas, own),
        members=MappingProxyType(dict(setup.members)),
    )


def robot(setup: RobotSetup, model: RobotModel, plan: OccupancyGrid) -> RobotCore:
    """Return the core of a robot with this floor plan. Raises AcrcError for invalid parts."""
    stack = setup.stack
    common = shared_map_data(plan, model, stack)
    localisation, navigation = _localisation(setup, model, common.field), navigator(common, model, stack)
    introspector = None
    if setup.detail == "full":
        introspector = Introspector(setup.id, localisation, navigation)
    with nullcontext() if introspector is None else observing_nodes(introspector):
        initial = start(setup, model, common.floor)
        behaviour = behaviour_of(setup.behaviour, initial)
        if setup.adversary is not None:
            behaviour = adversary(setup.adversary, behaviour, initial)
    parts = RobotParts(
        OdometryBuffer(model.sensor), localisation, navigation, behaviour, introspector=introspector
    )
    return RobotCore(
        setup.id, parts, entry=setup.behaviour, first_step=setup.first_step, step_us=setup.step_us
    )


def navigator(common: SharedMapData, model: RobotModel, stack: Stack) -> Navigator:
    """Return the navigation of a robot with this model and stack."""
    local = CostMap(model.sensor, model.footprint.circumradius, stack.local_map)
    return Navigator(_planner(common, stack), local, _local_planner(local, model, stack), stack.navigation)


def _local_planner(local: CostMap, model: RobotModel, stack: Stack) -> BaseLocalPlanner:
    if stack.dwa.rules == "indigo":
        return DwaLocalPlanner(local, model.drive, stack.dwa)
    return DiscLocalPlanner(local, model.footprint.circumradius, model.drive, stack.dwa)


def _planner(common: SharedMapData, stack: Stack) -> GlobalPlanner:
    if common.costs is not None:
        return NavfnPlanner(common.costs, stack.planner)
    return GridPlanner(common.floor, stack.planner)


def _localisation(setup: RobotSetup, model: RobotModel, field: LikelihoodField | None) -> Localisation:
    parameters = setup.stack.localisation
    if parameters is None or field is None:
        return DeadReckoning(setup.pose, setup.doubt)
    own = generator(setup.seed, "localisation", setup.id, setup.epoch)
    return Amcl(field, model.sensor, setup.pose, own, parameters, setup.doubt)


def kernels() -> dict[str, str]:
    """Compile all kernels of a robot and its recorder; return the fingerprints of the robot's, by module."""
    from actors.runtime.recording import scans  # noqa: PLC0415 - and the libraries of recordings

    scans.fingerprint()
    return fingerprints(KERNELS)
