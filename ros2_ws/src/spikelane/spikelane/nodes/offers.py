"""What publishers offer, and how a recorder subscribes to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
import importlib
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_support import check_for_type_support

from spikelane.bag.metadata import QosDuration, QosProfile


def adapted_qos(offers: Sequence[QosProfile], depth: int) -> QoSProfile:
    """Return the strictest profile that all the offers meet."""
    is_reliable = all(offer.reliability == 'reliable' for offer in offers)
    is_latched = all(offer.durability == 'transient_local' for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=(ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT),
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE),
    )


def problems(profile: QoSProfile, publishers: Iterable[TopicEndpointInfo]) -> Iterator[str]:
    """Yield what a subscription with this profile cannot receive of its publishers."""
    offers = [offered_qos(publisher.qos_profile) for publisher in publishers]
    if profile.reliability == ReliabilityPolicy.RELIABLE and any(
        offer.reliability == 'best_effort' for offer in offers
    ):
        yield 'has a later publisher that is best effort: it is not recorded'
    if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL and any(
        offer.durability == 'volatile' for offer in offers
    ):
        yield 'has a later publisher that does not latch: it is not recorded'


def message_type_of(type_name: str) -> Any:
    """Return the class of `package/msg/Type`, None where it is not installed."""
    package, _, name = type_name.partition('/msg/')
    try:
        message_type = getattr(importlib.import_module(f'{package}.msg'), name)
        check_for_type_support(message_type)
    except Exception:  # a broken installation must not end the recording
        return None
    return message_type


def offered_qos(profile: QoSProfile) -> QosProfile:
    """Return what a publisher offers, as a bag has it."""
    return QosProfile(
        history=profile.history.name.lower(),
        depth=profile.depth,
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline=QosDuration.from_nanoseconds(profile.deadline.nanoseconds),
        lifespan=QosDuration.from_nanoseconds(profile.lifespan.nanoseconds),
        liveliness=profile.liveliness.name.lower(),
        liveliness_lease_duration=QosDuration.from_nanoseconds(
            profile.liveliness_lease_duration.nanoseconds
        ),
    )
