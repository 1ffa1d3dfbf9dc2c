"""The checks of `sepmc verify`: small functions that fly a scene and give its lines."""
