"""The robot models that come with the testbed, one TOML file each; `actors.robot_model` reads them."""
