"""What campaigns and single runs show, on one page: sentences, pictures, and the numbers behind each picture."""
