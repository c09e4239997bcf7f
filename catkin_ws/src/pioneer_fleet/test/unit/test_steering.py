from pioneer_fleet.teleop.steering import Steering


def pressed(keys: str) -> Steering:
    steering = Steering()
    for key in keys:
        steering = steering.after(key)
    return steering


def test_keys_add_up_and_any_other_key_stops() -> None:
    assert pressed("wwa") == Steering(0.2, 0.2)
    assert pressed("wwas") == Steering(0.1, 0.2)
    assert pressed("wwa ") == Steering()


def test_the_speed_is_bounded() -> None:
    assert pressed("w" * 99 + "d" * 99) == Steering(1.0, -1.0)
